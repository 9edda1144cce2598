"""The job for the first process inside a user-mode Linux, and its result: two JSON files."""

from typing import NotRequired, TypedDict


class Job(TypedDict):
    """One command, and all that the guest needs to run it.

    All paths are the host's, which are valid in the guest, too.
    """

    executable: str  # absolute
    argv: list[str]  # argv[0] is the name the user gave
    env: dict[str, str]
    cwd: str
    umask: int
    user: int
    group: int
    groups: list[int]
    stdin: str  # /dev/null, or TERMINAL
    stdout: str  # a file to append to, or TERMINAL
    stderr: str  # may be the same file as stdout
    rows_columns: tuple[int, int]  # of the terminal
    hostname: str
    busybox: str
    modules: list[str]  # in the order in which they can be loaded
    interfaces: list[str]
    result: str  # where the Result is to be written


class Result(TypedDict):
    """The end of the job: either an exit code or a failure. If there is no Result, the guest's kernel has died."""

    exit_code: NotRequired[int]  # 0..255; 128 + n when signal n ended the command
    failure: NotRequired[str]  # why the command was not started
