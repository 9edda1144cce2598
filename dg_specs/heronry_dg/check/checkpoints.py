"""Checks rule DG512: a checkpoint whose states are too old when they arrive is of no use to another PE."""

from heronry_dg.check.subject import Subject
from heronry_dg.checkpoints import kept_modules, late_ns, period_ns
from heronry_dg.findings import Findings
from heronry_dg.rules import wire as rules
from heronry_dg.situation import Situation, hosts_when_all_is_up, survivors


def check_checkpoints(subject: Subject, findings: Findings) -> None:
    """Add a finding for each checkpoint that may be older than its `max_age_ms` when the next state arrives."""
    spec = subject.spec
    left = survivors(spec, Situation())
    for name in kept_modules(spec):
        module = spec.modules[name]
        checkpoint = module.checkpoint
        assert checkpoint is not None
        homes = hosts_when_all_is_up(spec, module)
        ways = {way for one in homes for other in homes if (way := left.route(one, other))}
        times = [late_ns(spec, checkpoint, way) for way in ways if all(spec.buses[bus].kind == "wired" for bus in way)]
        place = subject.place("modules", name, "checkpoint")
        if None in times:
            sentence = f"no state of '{name}' can be used on another PE: a bus on its way has max_load: 1"
            findings.add(rules.OLD_STATES, place, sentence, "write a smaller max_load, so that the time has a bound")
            continue
        oldest_ns = max((time for time in times if time is not None), default=0) + period_ns(checkpoint)
        if oldest_ns > checkpoint.max_age_ns:
            sentence = (
                f"a state of '{name}' may be {oldest_ns / 1e6:.0f} ms old when the next one arrives, "
                f"but only {checkpoint.max_age_ns / 1e6:g} ms are allowed"
            )
            findings.add(rules.OLD_STATES, place, sentence, "write a larger max_age_ms, a larger hz, or fewer bytes")
