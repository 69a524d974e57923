"""ROS packages as files: a correct one, and broken ones as public issues report them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

SETUP = """\
from setuptools import find_packages, setup

package_name = 'lab'

setup(
    name=package_name,
    version='0.0.0',
    packages=find_packages(exclude=['test']),
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/' + package_name]),
        ('share/' + package_name, ['package.xml']),
        ('share/' + package_name + '/launch', ['launch/lab.launch.py']),
    ],
    install_requires=['setuptools'],
    zip_safe=True,
    maintainer='a',
    maintainer_email='a@example.com',
    description='d',
    license='MIT',
    entry_points={'console_scripts': ['talker = lab.talker:main']},
)
"""
MANIFEST = """\
<?xml version="1.0"?>
<package format="3">
  <name>lab</name>
  <version>0.0.0</version>
  <description>d</description>
  <maintainer email="a@example.com">a</maintainer>
  <license>MIT</license>
  <exec_depend>rclpy</exec_depend>
  <export><build_type>ament_python</build_type></export>
</package>
"""
CONFIG = "[develop]\nscript_dir=$base/lib/lab\n[install]\ninstall_scripts=$base/lib/lab\n"
#: A correct package: path -> text.
PACKAGE = {
    "package.xml": MANIFEST,
    "setup.py": SETUP,
    "setup.cfg": CONFIG,
    "resource/lab": "",
    "lab/__init__.py": "",
    "lab/talker.py": "import rclpy\n\n\ndef main():\n    rclpy.init()\n",
    "launch/lab.launch.py": "from launch import LaunchDescription\n\n\n"
    "def generate_launch_description():\n    return LaunchDescription([])\n",
}
#: A file and its change, by the name of a defect; None removes the file.
_CHANGES: dict[str, tuple[str, tuple[str, str] | None]] = {
    "marker": ("resource/lab", None),
    "config": ("setup.cfg", None),
    "setup": ("setup.py", None),
    "folder": ("setup.py", ("find_packages(exclude=['test'])", "['labs']")),
    "syntax": ("setup.py", ("version='0.0.0',", "version='0.0.0'")),
    "import": ("setup.py", ("from setuptools", "import numpyy\nfrom setuptools")),
    "entry": ("setup.py", ("lab.talker:main", "lab/talker.py:main")),
    "function": ("setup.py", ("talker:main", "talker:run")),
    "data": ("setup.py", ("launch/lab.launch.py", "launch/other.launch.py")),
    "name": ("package.xml", ("<name>lab<", "<name>lap<")),
    "invalid": ("package.xml", ("</license>", "")),
    "type": ("package.xml", ("<export><build_type>ament_python</build_type></export>", "")),
    "place": ("setup.cfg", ("lib/lab", "lib/my_lab")),
}


def broken(name: str) -> dict[str, str]:
    """Return the package with a defect."""
    path, change = _CHANGES[name]
    files = dict(PACKAGE)
    if change is None:
        del files[path]
    else:
        assert change[0] in files[path]
        files[path] = files[path].replace(*change)
    return files


def write(folder: Path, files: Mapping[str, str]) -> None:
    """Write files into a folder."""
    for name, text in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
