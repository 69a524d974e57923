from setuptools import setup

package_name = "robot_app"

setup(
    name=package_name,
    version="0.1.0",
    packages=[package_name],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{package_name}"]),
        (f"share/{package_name}", ["package.xml"]),
    ],
    install_requires=["setuptools"],
    entry_points={
        "console_scripts": [
            "number_publisher = robot_app.number_publisher:main",
            "number_counter = robot_app.number_counter:main",
            "led_panel = robot_app.led_panel:main",
            "battery = robot_app.battery:main",
        ],
    },
)
