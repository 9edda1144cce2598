"""DG7xx, rules about the drivers of devices: they are found on this computer, and the spec fits what they declare.

drivers.py checks these rules in a spec that loads. The check imports code that is not part of heronry, so `check
--fast` leaves it out. The head of heronry_dg/rules/rule.py shows how a rule is added.
"""

from typing import Final

from heronry_dg.rules.rule import Family

FAMILY: Final = Family("DG7", "drivers: what they declare, and what a spec says of them", fast=False)


def _devices(gps: str = "", lamp: str = "") -> str:
    return f"devices:\n  gps: {{kind: sensor, pe: nav{gps}}}\n  lamp: {{kind: actuator, pe: tail{lamp}}}\n"


DRIVER_NOT_HERE = FAMILY.warning(
    "DG701",
    "driver-not-here",
    what="A driver is neither shipped nor installed here, and no import finds it, or its code cannot be loaded.",
    why=(
        "A PE does not start without the driver of a device. The code of a node need not be on this computer, so this "
        "is a warning; the options of such a driver are not checked."
    ),
    fix="Correct the name, or install the driver: a shipped one, an entry point, or `package.module:Class`.",
    bad=_devices(gps=", driver: gspd"),
    good=_devices(gps=", driver: gpsd"),
)
DRIVER_DOES_NOT_FIT = FAMILY.error(
    "DG702",
    "driver-does-not-fit",
    what="The driver of a sensor is named for an actuator, or that of an actuator for a sensor, or it cannot release.",
    why="The process of the device would end as soon as it starts, or its `safe` action would not be the one named.",
    fix="Name a driver for this kind of device; for one that cannot release, write `safe: hold` or a value.",
    bad=_devices(lamp=", driver: gpsd"),
    good=_devices(lamp=", driver: pwm, options: {output: 0}"),
)
OPTIONS_DO_NOT_FIT = FAMILY.error(
    "DG703",
    "options-do-not-fit",
    what="An option of a device is not one that its driver declares, is missing, or has a value that does not fit.",
    why="The process of the device would end as soon as it starts, and the device would be reported failed.",
    fix="Write the options that the driver declares; docs/devices.md lists those of the shipped drivers.",
    bad=_devices(gps=", driver: gpsd, options: {prot: 2947}"),
    good=_devices(gps=", driver: gpsd, options: {port: 2947}"),
)
OPTIONS_ALONE = FAMILY.error(
    "DG704",
    "options-alone",
    what="A device has `options`, and no `driver`.",
    why="Options belong to a driver; without it nobody reads them.",
    fix="Name the driver, or remove the options.",
    bad=_devices(gps=", options: {port: 2947}"),
    good=_devices(gps=", driver: gpsd, options: {port: 2947}"),
)
