"""For colcon; pip installs this package with semmap."""

from setuptools import setup

NAME = "semmap_ros"

setup(
    name=NAME,
    version="0.1.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/config", ["config/params.yaml"]),
        (f"share/{NAME}/launch", ["launch/semmap.launch.xml"]),
    ],
    entry_points={
        "console_scripts": [
            "semmap_node = semmap_ros.node:main",
            "semmap_mission = semmap_ros.mission:main",
            "semmap_recording = semmap_ros.recording:main",
        ]
    },
)
