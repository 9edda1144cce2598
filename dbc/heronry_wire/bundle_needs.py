"""What a bundle demands of the computer that runs it: a version of Python, and packages that are installed there."""

from importlib.metadata import PackageNotFoundError, version

from packaging.requirements import InvalidRequirement, Requirement

from heronry_wire.bundle import BundleError, ForeignBundleError, Manifest, this_python


def check_here(manifest: Manifest) -> None:
    """Raise ForeignBundleError where this Python, or what is installed in it, is not what a bundle needs."""
    if manifest.python != this_python():
        raise ForeignBundleError(
            f"it is for Python {manifest.python}, and this is {this_python()}: build it with this one"
        )
    for wheel in manifest.wheels:
        wanted = read_wheel(wheel)
        try:
            found = version(wanted.name)
        except PackageNotFoundError:
            raise ForeignBundleError(f"it needs {wheel}, which is not here: install it on this node") from None
        if not wanted.specifier.contains(found, prereleases=True):
            raise ForeignBundleError(f"it needs {wheel}, and {found} is here: install that version on this node")


def read_wheel(text: str) -> Requirement:
    """Read what a bundle needs besides its own files, as pip writes it; raises BundleError."""
    try:
        return Requirement(text)
    except InvalidRequirement as error:
        raise BundleError(f"'{text}' names no package: write it as for pip, for example numpy>=1.26") from error
