"""Debian packages unpacked into the user's cache, without root and without installing anything.

`unpacked("user-mode-linux")` returns the folder that holds the package's files as they would lie under ``/``. A package
is fetched once per distribution release and processor and then stays, so every later call needs one `stat`.

A package's folder is either absent or complete. The package is unpacked into a staging folder of fixed name, which is
then renamed in one step. A lock file lets only one process at a time fetch a package; the kernel releases the lock when
that process dies. So a process sees a whole package or none, and two callers that start together fetch a package once.
The next fetch removes the remains of a fetch that was killed.

The system's own package lists are tried first. If these lists are missing or too old (a fresh container), new lists are
fetched into the staging folder and used from there. The system's own state is never changed.
"""

import fcntl
import os
import platform
import shutil
import subprocess
import sys
from pathlib import Path

from heronry_tools.console.user_cache import user_cache
from heronry_tools.runtime.vcan.errors import CannotRunError


def cache_folder() -> Path:
    """Return the folder of the packages: ``heronry/uml/<release>-<processor>`` in the user's cache folder."""
    return user_cache("uml") / f"{_release()}-{platform.machine()}"


def _release() -> str:
    try:
        facts = platform.freedesktop_os_release()
    except OSError:
        return "unknown"
    return f"{facts.get('ID', 'unknown')}-{facts.get('VERSION_ID', 'rolling')}"


def unpacked(package: str) -> Path:
    """Return the folder with `package`'s files, fetched now if needed; raises CannotRunError with apt's reason."""
    cache = cache_folder()
    folder = cache / package
    if folder.is_dir():
        return folder
    missing = [tool for tool in ("apt-get", "dpkg") if shutil.which(tool) is None]
    if missing:
        load = "load vcan into this kernel (as root: modprobe vcan)"
        other = "install candump and cansend yourself" if package == "can-utils" else load
        raise CannotRunError(
            f"Debian's package {package} is needed, and there is no {missing[0]} here to fetch it: use Debian 12 or "
            f"newer (a container will do), or {other}"
        )
    try:
        cache.mkdir(parents=True, exist_ok=True)
        with (cache / "lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not folder.is_dir():  # another process may have fetched it meanwhile
                _fetch(package, staging=cache / "staging", folder=folder)
    except OSError as error:
        raise CannotRunError(
            f"{cache} cannot be written ({error.strerror}): set XDG_CACHE_HOME to a folder of yours"
        ) from error
    return folder


def _fetch(package: str, staging: Path, folder: Path) -> None:
    print(f"with-vcan: fetching Debian's {package} into {folder} (this once)", file=sys.stderr, flush=True)
    shutil.rmtree(staging, ignore_errors=True)
    staging.mkdir()
    try:
        archive = _downloaded(package, staging)
        unpack = _run(["dpkg", "-x", str(archive), str(staging / "files")], staging)
        if unpack.returncode != 0:
            raise CannotRunError(
                f"dpkg could not unpack {archive.name} ({_reason(unpack)}): make room in {folder.parent}, then try "
                "again"
            )
        (staging / "files").rename(folder)
    finally:
        shutil.rmtree(staging, ignore_errors=True)


def _downloaded(package: str, staging: Path) -> Path:
    """Download a package into `staging`, and return the path of its archive.

    The first download uses the system's package lists. If it fails, this function fetches new lists, and
    downloads the package with these. Raises CannotRunError if the second download fails, too.
    """
    as_we_are = ["-o", "APT::Sandbox::User="]  # root would hand the download to a user that may not write here
    lists = staging / "lists"
    own_lists = ["-o", f"Dir::State::Lists={lists}", "-o", f"Dir::Cache={staging / 'cache'}"]
    attempt = _run(["apt-get", *as_we_are, "download", package], staging)
    if attempt.returncode != 0:
        (lists / "partial").mkdir(parents=True)
        (staging / "cache" / "archives" / "partial").mkdir(parents=True)
        # This command fails if one of several sources is dead; the download shows whether that source is needed.
        _run(["apt-get", *as_we_are, *own_lists, "update"], staging)
        attempt = _run(["apt-get", *as_we_are, *own_lists, "download", package], staging)
    archives = sorted(staging.glob("*.deb"))
    if attempt.returncode != 0 or not archives:
        raise CannotRunError(
            f"apt-get could not download {package} ({_reason(attempt)}): check the network and apt's sources, then "
            "try again"
        )
    return archives[0]


def _run(command: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        command,
        cwd=folder,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        errors="replace",
        env={**os.environ, "LC_ALL": "C"},
        check=False,
    )


def _reason(finished: subprocess.CompletedProcess[str]) -> str:
    """Return the error message of a tool on one line."""
    lines = [line for line in finished.stderr.splitlines() if line.strip()]
    errors = [line.removeprefix("E:").strip() for line in lines if line.startswith("E:")]
    return "; ".join(errors or lines[-1:]) or f"exit code {finished.returncode}"
