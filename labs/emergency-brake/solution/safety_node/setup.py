from setuptools import setup

package_name = "safety_node"

setup(
    name=package_name,
    version="0.1.0",
    packages=[package_name],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{package_name}"]),
        (f"share/{package_name}", ["package.xml"]),
    ],
    install_requires=["setuptools", "numpy"],
    entry_points={"console_scripts": ["safety_node = safety_node.safety_node:main"]},
)
