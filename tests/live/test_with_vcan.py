"""tools/with-vcan, called as a user calls it: input reaches the command, and its output reaches the user.

Where the kernel has no vcan, these tests boot a user-mode Linux once per call, about a second each.
"""

import fcntl
import json
import os
import pty
import select
import shutil
import signal
import socket
import subprocess
import sys
import termios
import time
from contextlib import suppress
from pathlib import Path

import pytest

from live.processes import processes_that_mention
from thoroughness import mostly_soak

ROOT = Path(__file__).resolve().parents[2]
WITH_VCAN = [sys.executable, str(ROOT / "tools" / "with-vcan")]
HOST_HAS_VCAN = Path("/sys/class/net/vcan0").exists()
PATIENCE_S = 60.0
CAN_BE_HAD = HOST_HAS_VCAN or shutil.which("apt-get") is not None
# candump does not say when it has begun to listen
UNTIL_CANDUMP_SAW = "candump -n 1 -L any & while kill -0 $! 2>/dev/null; do {}; done; wait"

pytestmark = [
    pytest.mark.live,
    pytest.mark.xdist_group("with-vcan"),  # one after the other: a kernel that has vcan has each interface once
    pytest.mark.skipif(not CAN_BE_HAD, reason="no vcan0 in this kernel, and no apt-get to fetch one"),
]
user_mode_only = pytest.mark.skipif(HOST_HAS_VCAN, reason="the kernel's own vcan0 is used here, no user-mode Linux")


def with_vcan(*words: str, cwd: Path = ROOT, env: dict[str, str] | None = None) -> subprocess.CompletedProcess[bytes]:
    return subprocess.run([*WITH_VCAN, *words], cwd=cwd, env=env, capture_output=True, check=False, timeout=300)


def python_inside(script: str, *words: str) -> subprocess.CompletedProcess[bytes]:
    return with_vcan("--timeout", "120", sys.executable, "-c", script, *words)


def interface_names() -> set[str]:
    return {name for _, name in socket.if_nameindex()}


def processes_in(folder: Path) -> list[str]:
    """Processes that work in a folder, as all of a guest's do, whatever they call themselves."""
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if (process / "cwd").readlink() == folder:
                found.append(process.name)
    return found


@pytest.mark.soak  # the next one has an exit code in every run
def test_the_exit_code_is_the_commands_if_a_signal_ended_it() -> None:
    assert with_vcan("sh", "-c", "kill -TERM $$").returncode == 128 + signal.SIGTERM


def test_stdout_and_stderr_stay_apart_stdin_is_empty_and_the_exit_code_is_the_commands() -> None:
    done = with_vcan("sh", "-c", "echo to stdout; echo to stderr >&2; cat; exit 7")
    assert done.returncode == 7
    assert done.stdout == b"to stdout\n"
    assert done.stderr.endswith(b"to stderr\n")
    assert b"to stdout" not in done.stderr


def test_on_a_terminal_a_shell_can_be_typed_to() -> None:
    """The shell has job control: Ctrl-C ends what runs in it, and not the shell."""
    master, terminal = pty.openpty()
    shell = [*WITH_VCAN, "bash", "--norc", "--noprofile"]
    process = subprocess.Popen(
        shell,
        stdin=terminal,
        stdout=terminal,
        stderr=terminal,
        start_new_session=True,
        env={**os.environ, "PS1": "# "},  # an activated virtual environment exports a prompt of its own
        preexec_fn=_take_terminal,  # noqa: PLW1509 - it makes one system call
    )
    before = termios.tcgetattr(terminal)
    try:
        type_and_see(master, "", b"# ")
        type_and_see(master, "echo $((6 * 7)) in $(cat /sys/class/net/vcan0/type)\r", b"42 in 280")
        type_and_see(master, "sh -c 'echo on; exec sleep 1000'\r", b"on\n")  # who writes has the terminal by then
        type_and_see(master, "\x03", b"# ")
        type_and_see(master, "[ -t 0 ] && exit 7\r", b"")
        assert process.wait(60) == 7
        assert termios.tcgetattr(terminal) == before
    finally:
        process.terminate()
        process.wait(60)
        os.close(master)
        os.close(terminal)


def _take_terminal() -> None:
    fcntl.ioctl(0, termios.TIOCSCTTY, 0)


def type_and_see(master: int, text: str, expected: bytes) -> None:
    """Type on the terminal, and wait until the command has written something."""
    os.write(master, text.encode())
    seen = b""
    while expected not in seen.replace(b"\r", b""):
        assert select.select([master], [], [], 60)[0], seen
        seen += os.read(master, 1 << 12)


def test_output_to_one_place_keeps_its_order(tmp_path: Path) -> None:
    transcript = tmp_path / "transcript"
    with transcript.open("wb") as file:
        subprocess.run(
            [*WITH_VCAN, "sh", "-c", "echo 1; echo 2 >&2; echo 3; echo 4 >&2"],
            stdout=file,
            stderr=subprocess.STDOUT,
            check=True,
        )
    assert transcript.read_bytes().endswith(b"1\n2\n3\n4\n")


def test_every_byte_arrives() -> None:
    done = with_vcan("sh", "-c", "head -c 3000000 /dev/zero; printf '\\377\\r\\n\\001'")
    assert done.stdout == bytes(3_000_000) + b"\xff\r\n\x01"


def test_arguments_environment_and_folder_arrive_unchanged(tmp_path: Path) -> None:
    folder = tmp_path / "a folder's name"
    folder.mkdir()
    words = ["a b", "", "'", '"', "$HOME", "*", "back\\slash", "line\nbreak", "--timeout", "ünïcode"]
    env = {**os.environ, "HERONRY_TEST": " 'two'\nlines ", "not-a-shell-name%%": "x"}
    script = "import json, os, sys; print(json.dumps([sys.argv[1:], os.getcwd(), dict(os.environ), os.getuid()]))"
    done = with_vcan(sys.executable, "-c", script, *words, cwd=folder, env=env)
    seen_words, seen_folder, seen_env, user = json.loads(done.stdout)
    assert seen_words == words
    assert seen_folder == str(folder)
    assert {name: seen_env.get(name) for name in env if name != "PATH"} == {
        name: value for name, value in env.items() if name != "PATH"
    }
    assert seen_env["PATH"].startswith(env["PATH"])
    assert user == os.getuid()


def test_files_written_inside_are_the_callers_own(tmp_path: Path) -> None:
    assert with_vcan("sh", "-c", "umask 027; echo content > note", cwd=tmp_path).returncode == 0
    note = tmp_path / "note"
    assert note.read_text() == "content\n"
    assert note.stat().st_uid == os.getuid()
    assert note.stat().st_mode & 0o777 == 0o640


@pytest.mark.soak  # test_two_interfaces_are_two_buses has the same tools in every run
def test_candump_sees_a_frame_from_cansend() -> None:
    done = with_vcan("--timeout", "120", "sh", "-c", UNTIL_CANDUMP_SAW.format("cansend vcan0 321#C0FFEE"))
    assert done.stdout.endswith(b" vcan0 321#C0FFEE\n")


@pytest.mark.soak  # every test that is marked vcan talks through python-can there
def test_python_can_sends_and_receives() -> None:
    done = python_inside(
        "import can\n"
        "with can.Bus('vcan0', interface='socketcan') as here, can.Bus('vcan0', interface='socketcan') as there:\n"
        "    here.send(can.Message(arbitration_id=0x12C, is_extended_id=False, data=[1, 2, 3]))\n"
        "    message = there.recv(10)\n"
        "print(hex(message.arbitration_id), bytes(message.data))\n"
    )
    assert done.stdout == b"0x12c b'\\x01\\x02\\x03'\n", done.stderr.decode()


def test_two_interfaces_are_two_buses() -> None:
    done = with_vcan(
        *("--timeout", "120", "--interfaces", "vcan0,vcan1", "sh", "-c"),
        UNTIL_CANDUMP_SAW.format("cansend vcan1 001#") + "; cat /sys/class/net/vcan0/statistics/rx_packets",
    )
    lines = done.stdout.splitlines()
    assert lines[0].endswith(b" vcan1 001#")
    assert lines[1] == b"0"


def test_a_command_that_takes_too_long_is_ended() -> None:
    done = with_vcan("--timeout", "3", "sleep", "1000")
    assert done.returncode == 124
    assert done.stderr.endswith(b"with-vcan: sleep was ended after 3 s (--timeout)\n")


def running(temporary: Path) -> subprocess.Popen[bytes]:
    """Start a command that runs on, and wait until it says so; what with-vcan needs lies in this folder."""
    process = subprocess.Popen(
        [*WITH_VCAN, "sh", "-c", "sleep 1000 & echo running; wait"],
        env={**os.environ, "TMPDIR": str(temporary)},
        stdout=subprocess.PIPE,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == b"running\n"
    return process


@pytest.mark.parametrize("stop", mostly_soak([signal.SIGINT, signal.SIGTERM, signal.SIGHUP], [signal.SIGTERM]))
def test_a_signal_ends_everything_and_leaves_nothing(stop: signal.Signals, tmp_path: Path) -> None:
    interfaces = interface_names()
    process = running(tmp_path)
    assert process.stdout is not None
    with process.stdout:
        process.send_signal(stop)
        assert process.wait(60) == -stop
    assert list(tmp_path.iterdir()) == []
    assert processes_that_mention(str(tmp_path)) == []
    assert interface_names() == interfaces


@user_mode_only
def test_killed_it_leaves_no_process(tmp_path: Path) -> None:
    process = running(tmp_path)
    assert process.stdout is not None
    with process.stdout:
        process.kill()
        process.wait(60)
    (folder,) = tmp_path.iterdir()
    until_s = time.monotonic() + PATIENCE_S
    while left := processes_in(folder):
        assert time.monotonic() < until_s, left
        time.sleep(0.02)


@pytest.mark.parametrize(
    ("words", "exit_code", "sentence"),
    [
        (["no-such-command"], 127, b"no-such-command was not found"),
        ([], 125, b"a command to run is missing"),
        (["--timeout", "soon", "true"], 125, b"'soon' is not a number of seconds above zero"),
        (["--interfaces", "vcan0,vcan0", "true"], 125, b"is not a list of different interface names"),
    ],
)
def test_a_mistake_is_answered_by_one_sentence(words: list[str], exit_code: int, sentence: bytes) -> None:
    done = with_vcan(*words)
    assert done.returncode == exit_code
    assert sentence in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_a_file_that_is_no_program_is_named(tmp_path: Path) -> None:
    file = tmp_path / "not-a-program"
    file.write_text("no first line says what runs this\n")
    file.chmod(0o755)
    done = with_vcan(str(file))
    assert done.returncode in {125, 126}
    assert f"cannot run {file}: Exec format error" in done.stderr.decode()


@user_mode_only
def test_without_apt_the_remedy_is_named(tmp_path: Path) -> None:
    done = with_vcan("true", env={**os.environ, "PATH": str(tmp_path), "XDG_CACHE_HOME": str(tmp_path)})
    assert done.returncode == 125
    assert b"no apt-get here" in done.stderr
    assert b"install candump and cansend yourself" in done.stderr


@user_mode_only
def test_two_that_start_together_fetch_a_package_once(tmp_path: Path) -> None:
    script = "from heronry_tools.runtime.vcan.debian_packages import unpacked; print(unpacked('can-utils'))"
    both = [
        subprocess.Popen(
            [sys.executable, "-c", script],
            env={**os.environ, "XDG_CACHE_HOME": str(tmp_path)},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        for _ in range(2)
    ]
    answers = [process.communicate(timeout=300) for process in both]
    assert answers[0][0] == answers[1][0]
    assert (Path(answers[0][0].strip()) / "usr" / "bin" / "candump").exists()
    assert sum(notes.count("fetching") for _, notes in answers) == 1
    assert sorted(path.name for path in Path(answers[0][0].strip()).parent.iterdir()) == ["can-utils", "lock"]
