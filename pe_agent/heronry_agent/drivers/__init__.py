"""Shipped drivers of real devices, each after the public data sheet or protocol of what it speaks to.

A file has two parts: what the bytes or lines of the device mean, as pure functions that tests try with any input; and
a small class of `heronry_agent.device_driver`, which has the input and output. A library of an extra
(`pip install heronry[devices]`) is imported when a driver opens its device, never before.

    name           device                                        value
    gpsd           a satellite receiver behind gpsd              position (below)
    nmea           a satellite receiver on a serial line         position
    canaerospace   a node that is no PE, on a bus of the PE      the value of its datum
    iio            a channel of an IIO chip, in                  raw value x scale, or volts, degrees ... of the chip
    iio_buffer     the same, sampled by a trigger                the same
    iio_out        a channel of an IIO chip, out                 the same
    bmp280         a barometer on I2C                            hPa
    ms5611         a barometer on I2C                            hPa
    pwm            a servo on a PWM output                       degrees, or what `from` and `to` say
    sysfs_out      a file of the kernel that takes a number      whatever `scale` and `offset` make of it
    gpio           a burn wire or solenoid on a GPIO line        1 on, 0 off

A position is a tuple of four whole numbers: latitude and longitude in 1e-7 degrees (north and east are positive),
altitude above mean sea level in mm, track over ground in 1e-5 degrees (true north is 0).
"""

from collections.abc import Mapping
from typing import Final

SHIPPED: Final[Mapping[str, str]] = {
    "bmp280": "heronry_agent.drivers.bmp280:Bmp280",
    "canaerospace": "heronry_agent.drivers.canaerospace:ForeignNode",
    "gpio": "heronry_agent.drivers.gpio:GpioLine",
    "gpsd": "heronry_agent.drivers.gpsd:Gpsd",
    "iio": "heronry_agent.drivers.iio:IioInput",
    "iio_buffer": "heronry_agent.drivers.iio_buffer:IioBuffer",
    "iio_out": "heronry_agent.drivers.iio:IioOutput",
    "ms5611": "heronry_agent.drivers.ms5611:Ms5611",
    "nmea": "heronry_agent.drivers.nmea:NmeaReceiver",
    "pwm": "heronry_agent.drivers.pwm:PwmServo",
    "sysfs_out": "heronry_agent.drivers.sysfs_number:SysfsOutput",
}
