from pathlib import Path

from setuptools import find_packages, setup

PACKAGE = "mhsb_sim"


def share_folder(folder: str) -> list[tuple[str, list[str]]]:
    """Every file below `folder`, for the same place below the package's share folder."""
    files = sorted(path for path in Path(folder).rglob("*") if path.is_file())
    return [(f"share/{PACKAGE}/{path.parent}", [str(path)]) for path in files]


setup(
    name=PACKAGE,
    version="0.1.0",
    description="Simulator of the hydraulic manipulator",
    license="Apache-2.0",
    maintainer="MHSB maintainers",
    maintainer_email="maintainers@mhsb.invalid",
    packages=find_packages(exclude=["test"]),
    package_data={PACKAGE: ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        *share_folder("launch"),
    ],
    install_requires=["setuptools"],
    extras_require={"test": ["pytest"]},
    zip_safe=False,
    entry_points={
        "console_scripts": [
            "sim_node = mhsb_sim.ros.sim_node:main",
            "simulate = mhsb_sim.commands.simulate_command:main",
            "compare = mhsb_sim.study.compare_command:main",
            "study = mhsb_sim.study.study_command:main",
            "tune = mhsb_sim.study.tune_command:main",
            "record = mhsb_sim.recording.record_command:main",
            "report = mhsb_sim.report.report_command:main",
            "demo = mhsb_sim.commands.demo_command:main",
        ],
    },
)
