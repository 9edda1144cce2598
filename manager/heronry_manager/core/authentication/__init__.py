"""Authentication: with a key, which frames of PEs and managers are proven, and how this manager proves its own.

*What is decided.* `authenticity` decides whether a state, an EMCY or a command counts. Its state is the *session* of
each PE:

    no session ─► offered ─► open        back to `no session` with a new term; a newer session replaces an open one

`nonce_answers` decides which nonces are answered, and `attack_rate` when refused frames amount to an attack.

*Who may change it.* A page 2 of a PE asks for a session, and the first believed page 0 opens it. A standby manager
follows the sessions that the active one opens. A frame without proof ends no session.

*What may go wrong.*

    lost       A PE repeats its nonce until it has an answer. If states of a PE cannot be believed for T_lease, RENEW
               makes the PE ask anew. A lost EMCY holds up the page 0 that would prove it, until it comes again
    late       A page 0 whose number is not above the last one is refused
    doubled    The same, and a nonce is not answered twice within half a heartbeat period
    forged     A frame with a wrong tag is counted, and has no other effect. After GUESSES wrong tags, two proven pages
               in a row are demanded
    restart    No session is known; every PE that hears the new term asks for one. No number is used twice, since
               numbers are reserved on disk before they are used (`memory`)

Without a key there is no such object, and every frame counts. The protocol: docs/protocol/authentication.md.
"""

from heronry_manager.core.authentication.authenticity import Authenticity

__all__ = ["Authenticity"]
