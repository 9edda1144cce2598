"""The first process inside a user-mode Linux: it makes the CAN interfaces, runs a command, and powers off.

The guest's kernel starts this file as `python -I -S guest.py JOB`, over the host's own file system. The file imports
only json, and modules that json or a starting Python has loaded already (no pathlib, no subprocess, no module of this
package), since an import takes up to 0.1 s here.

The process sets the guest up, runs the command, and powers the guest off. An error before the command runs becomes the
`failure` of the result. If this process itself dies, the guest's kernel panics, and the outer program finds no result.
The command runs as the calling user, so that its files belong to that user; only this process is root in the guest.
"""
# ruff: noqa: PTH103, PTH104, PTH123, PTH211 - without pathlib, see above

import json
import os
import signal
import sys

TYPE_CHECKING = False
if TYPE_CHECKING:
    from heronry_tools.runtime.vcan.job import Job, Result

SHARED_MEMORY = "/dev/shm"  # noqa: S108 - a folder of the guest, and empty
MOUNTS = (("proc", "/proc"), ("sysfs", "/sys"), ("tmpfs", "/run"), ("devpts", "/dev/pts"), ("tmpfs", SHARED_MEMORY))
DEVICE_LINKS = (("fd", ""), ("stdin", "/0"), ("stdout", "/1"), ("stderr", "/2"))
TERMINAL = "/dev/tty1"
CANNOT_EXECUTE = 126  # the shells' exit code for a program that cannot be executed


class SetupError(Exception):
    """A step of the set-up failed; the message names it."""


def busybox(job: "Job", *words: str) -> None:
    """Run a tool of busybox; raises SetupError if the tool fails.

    The tool's own error message appears on the kernel's console.
    """
    pid = os.posix_spawn(job["busybox"], ["busybox", *words], {})  # much faster here than a fork of all of Python
    if os.waitpid(pid, 0)[1] != 0:
        raise SetupError(f"{' '.join(words)} failed")


def mount_system(job: "Job") -> None:
    """Mount the guest's own /proc, /sys and the like over the host's files; the kernel has mounted /dev already."""
    for kind, place in MOUNTS:
        os.makedirs(place, exist_ok=True)
        busybox(job, "mount", "-t", kind, kind, place)
    os.makedirs("/run/lock", exist_ok=True)
    for name, number in DEVICE_LINKS:
        os.symlink(f"/proc/self/fd{number}", f"/dev/{name}")
    with open("/proc/sys/kernel/hostname", "w", encoding="utf-8") as hostname:
        hostname.write(job["hostname"])


def make_interfaces(job: "Job") -> None:
    """Load the CAN modules, create the vcan interfaces of the job, and set them and the loopback interface up."""
    for module in job["modules"]:
        busybox(job, "insmod", module)
    for name in job["interfaces"]:
        busybox(job, "ip", "link", "add", name, "type", "vcan")
        busybox(job, "ip", "link", "set", name, "up")
    busybox(job, "ip", "link", "set", "lo", "up")


def prepare_terminal(job: "Job") -> None:
    """Make the guest's terminal as wide as the user's, and hand it to the user.

    Only one of the two terminals may add a carriage return to the end of a line. If standard input is a terminal, the
    outer program makes the user's terminal raw (`keyboard`), so the guest's terminal adds the carriage return. If not,
    the user's terminal adds it.
    """
    rows, columns = job["rows_columns"]
    processing = "opost" if job["stdin"] == TERMINAL else "-opost"
    os.open(TERMINAL, os.O_RDWR | os.O_NOCTTY)  # never closed: a terminal that no process holds forgets its size
    busybox(job, "stty", "-F", TERMINAL, processing, "rows", str(rows), "cols", str(columns))
    os.chown(TERMINAL, job["user"], job["group"])


def become_command(job: "Job") -> None:
    """Replace this child process by the command: with the caller's folder, identity and environment.

    Never returns; raises OSError if the command cannot be started.
    """
    os.setsid()
    write = os.O_WRONLY | os.O_APPEND | os.O_NOCTTY
    # A terminal that is opened here becomes the one that controls this session: Ctrl-C ends what runs in it.
    streams = (os.open(job["stdin"], os.O_RDONLY), os.open(job["stdout"], write), os.open(job["stderr"], write))
    for number, stream in enumerate(streams):
        os.dup2(stream, number)
    os.closerange(3, 256)
    for ignored_by_python in (signal.SIGPIPE, signal.SIGXFSZ):
        signal.signal(ignored_by_python, signal.SIG_DFL)
    os.umask(job["umask"])
    os.setgroups(job["groups"])
    os.setgid(job["group"])
    os.setuid(job["user"])
    os.chdir(job["cwd"])
    os.execve(job["executable"], job["argv"], job["env"])  # noqa: S606 - starting that program is the task


def run_command(job: "Job") -> int:
    """Run the command to its end and return its exit code; meanwhile reap its orphans, as an init process must."""
    child = os.fork()
    if child == 0:
        try:
            become_command(job)
        except OSError as error:
            os.write(2, f"with-vcan: cannot run {job['argv'][0]}: {error.strerror}\n".encode(errors="replace"))
        finally:
            os._exit(CANNOT_EXECUTE)
    while True:
        pid, status = os.wait()
        if pid == child:
            code = os.waitstatus_to_exitcode(status)
            return code if code >= 0 else 128 - code


def drain_terminal(job: "Job") -> None:
    """Wait until the terminal has sent all output of the command out of the guest.

    This sets a mode of the terminal by stty, which waits for the output first.
    """
    busybox(job, "stty", "-F", TERMINAL, "-opost")


def carry_out(job: "Job") -> "Result":
    """Set the guest up and run the command; returns the result, with the failure if a step fails."""
    uses_terminal = TERMINAL in (job["stdin"], job["stdout"], job["stderr"])
    try:
        mount_system(job)
        make_interfaces(job)
        if uses_terminal:
            prepare_terminal(job)
        exit_code = run_command(job)
        if uses_terminal:
            drain_terminal(job)
    except (OSError, SetupError) as error:
        return {"failure": str(error)}
    return {"exit_code": exit_code}


def main() -> None:
    """Do the job whose file is the only argument, write its result, and power off.

    The result is written under another name and then renamed, so that a reader finds only a complete result.
    """
    with open(sys.argv[1], encoding="utf-8") as file:
        job: Job = json.load(file)
    result = carry_out(job)
    partial = job["result"] + ".partial"
    with open(partial, "w", encoding="utf-8") as file:
        json.dump(result, file)
    os.rename(partial, job["result"])
    os.sync()
    busybox(job, "poweroff", "-f")


if __name__ == "__main__":
    main()
