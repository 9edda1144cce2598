"""Heartbeat: what an active manager sends in each period, and the frames that cannot wait for the next one.

*What is decided.* `beat` decides when a beat is due, and what else goes out at once; `beacon` numbers and builds LEASE,
ALIVE and PING; `announcing` chooses the next fact that a standby manager must know. There is one state: the time of the
next beat, and the place in the round of facts.

*Who may change it.* The time alone. Each term begins anew. What is said follows from `knowledge`; nothing here changes
it.

*What may go wrong.* No frame of a beat is acknowledged. If a beat is lost, the next one says the same; a late beat is
not made up for; a doubled one has no effect; a forged one is the business of who hears it (docs/protocol/mastership.md
and docs/protocol/exclusion.md). After a restart the first beat of the new term is due immediately.
"""

from heronry_manager.core.heartbeat.beat import Beat

__all__ = ["Beat"]
