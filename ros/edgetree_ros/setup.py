"""The package as colcon builds it."""

from setuptools import setup

NAME = "edgetree_ros"

setup(
    name=NAME,
    version="0.2.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", ["launch/edgetree.launch.xml"]),
        (f"share/{NAME}/config", ["config/edgetree.yaml"]),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
    maintainer="The edgetree maintainers",
    maintainer_email="maintainers@edgetree.invalid",
    license="Apache-2.0",
    description="Find, measure and follow trees in the pictures of a depth camera.",
    entry_points={"console_scripts": [f"edgetree_node = {NAME}.node:main"]},
)
