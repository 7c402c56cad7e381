"""Files that a robot file names: relative, absolute, or in a package."""

import os
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from urllib.parse import unquote

from space_envs.errors import ConfigurationError

Packages = Mapping[str, Path]  # name -> folder, as the user gives them
_SCHEMES = ("package://", "model://")


def resolve(name: str, beside: Path, packages: Packages) -> Path:
    """Path of a file that is named in the file `beside`, whether or not it exists.

    `package://NAME/file` is looked for in `packages`, in the folders of ROS_PACKAGE_PATH, under share/ in
    those of AMENT_PREFIX_PATH, in the folders above `beside`, and in the share/ folder of this Python
    environment, where example-robot-data lies.

    Raises:
        ConfigurationError: if a package is nowhere; the message says where was looked.
    """
    for scheme in _SCHEMES:
        if name.startswith(scheme):
            package, _, rest = name.removeprefix(scheme).partition("/")
            return _folder(package, beside, packages) / rest
    if name.startswith("file://"):
        name = unquote(name.removeprefix("file://"))
    return beside.parent / name


def _folder(package: str, beside: Path, packages: Packages) -> Path:
    if package in packages:
        return packages[package]
    for folder in _candidates(package, beside):
        if folder.is_dir():
            return folder
    places = ", ".join(
        [
            f"the table [packages] ({', '.join(packages) or 'empty'})",
            f"ROS_PACKAGE_PATH ({os.environ.get('ROS_PACKAGE_PATH') or 'not set'})",
            f"AMENT_PREFIX_PATH ({os.environ.get('AMENT_PREFIX_PATH') or 'not set'})",
            "the folders above the file and this Python environment",
        ]
    )
    hint = " It comes with: pip install example-robot-data" if package == "example-robot-data" else ""
    raise ConfigurationError(
        f"there is no package {package!r} in {places}. Write where it lies: [packages] {package} = "
        f'"../path/of/{package}"{hint}'
    )


def _candidates(package: str, beside: Path) -> Iterator[Path]:
    for root in _folders("ROS_PACKAGE_PATH"):
        yield from ([root] if root.name == package else [root / package])
    for prefix in _folders("AMENT_PREFIX_PATH"):
        yield prefix / "share" / package
    for above in beside.resolve().parents:
        yield from ([above] if above.name == package else [above / package])
    for prefix in (*(Path(entry) / "cmeel.prefix" for entry in sys.path if entry), Path(sys.prefix)):
        yield prefix / "share" / package


def _folders(variable: str) -> list[Path]:
    return [Path(entry) for entry in os.environ.get(variable, "").split(os.pathsep) if entry]
