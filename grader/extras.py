"""Optional parts of the installation, and the error if one is missing."""

from __future__ import annotations

from grader.errors import PlatformError

#: Name of the package for pip.
PACKAGE = "ros-lab-grader"
#: Extra of the package by the module that it installs.
EXTRAS = {
    "distributed": "cluster",
    "mujoco": "mujoco",
    "scipy": "scipy",
    "starlette": "desk",
    "uvicorn": "desk",
}


def missing_extra(module: str) -> PlatformError:
    """Return the error for a missing module of an extra, e.g. `uvicorn`."""
    extra = EXTRAS[module]
    wanted = f"'{PACKAGE}[{extra}]'"
    remedy = (
        f"Install the extra {extra!r} as you installed grade: pip install {wanted},"
        f" pipx install --force {wanted} or uv tool install {wanted}"
        f" (in a checkout: pip install -e '.[{extra}]')"
    )
    return PlatformError(f"the Python package {module} is not installed", remedy=remedy)
