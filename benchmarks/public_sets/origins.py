"""Sources and licences of the recordings, by folder; from the README beside each of them."""

from __future__ import annotations

from dataclasses import dataclass

UNSTATED = "none stated (all rights reserved)"


@dataclass(frozen=True)
class Origin:
    """Where recordings come from, and what their licence allows."""

    repository: str  # OWNER/NAME on GitHub
    commit: str
    licence: str
    cite: str

    @property
    def source(self) -> str:
        """Web page of the repository at the commit."""
        return f"https://github.com/{self.repository}/tree/{self.commit}"


ORIGINS = {
    "ur10e_mamedov": Origin(
        "shamilmamedov/dynamic_calibration",
        "11af40e7deb758ec080a175fed8fcdd6c99aca29",
        UNSTATED,
        "Mamedov, Mikhel, Frontiers in Robotics and AI 7, 2020, doi 10.3389/frobt.2020.571574",
    ),
    "emps_janot": Origin(
        "forgi86/sysid-neural-continuous",
        "956aa7ecd73061b0321c6f6098d74c9e4a7ce67a",
        "none stated (licence of the repository: Apache-2.0)",
        "Janot, Gautier, Brunot, Data Set and Reference Models of EMPS, Nonlinear Sys. Id. Benchmarks, 2019",
    ),
    "staubli_tx40": Origin(
        "thanhndv212/figaroh-examples",
        "c0b5c7f0fda10078be55104f9ee76ac106b7a5ee",
        "Apache-2.0 (stated in its program files)",
        "Nguyen, Bonnet, Sabbah, Gautier, Fernbach and others, FIGAROH, IEEE-RAS Humanoids, 2023",
    ),
    "panda_gaz2019": Origin(
        "marcocognetti/FrankaEmikaPandaDynModel",
        "24d85ce4e648e2e894c832bfeee9b16711eb1a1a",
        "GPL-3.0",
        "Gaz, Cognetti, Oliva, Robuffo Giordano, De Luca, IEEE Robotics and Automation Letters 4(4), 2019",
    ),
    "rokae_xmate": Origin(
        "YanjunLIU-ac/Dynamic_Parameter_Identification_for_Rokae_xMate",
        "d5855f4731b00fc90061c838d66cc40c59f88c7d",
        UNSTATED,
        "its repository",
    ),
    "dvrk_wpi": Origin(
        "WPI-AIM/dvrk_dynamics_identification",
        "7697d3a6c90866c1846f0d3054d7f78384ab1ef9",
        UNSTATED,
        "Wang, Gondokaryono, Munawar, Fischer, IEEE Robotics and Automation Letters, 2019",
    ),
    "dvrk_psm_radiang": Origin(
        "radiang/dvrk_parameter_identification",
        "b044f8f66e38006a6b8a9fe750d8d3344854da87",
        UNSTATED,
        "its repository",
    ),
    "kuka_lwr4_flobaroid": Origin(
        "kjyv/FloBaRoID",
        "e6c077ea",  # of its history: later commits hold pointers in place of the recordings
        "LGPL-3.0",
        "its repository",
    ),
    "dfki_simple_pendulum": Origin(
        "dfki-ric-underactuated-lab/torque_limited_simple_pendulum",
        "ed17ea2d32a35ad944944ca03ef57693e2986732",
        "BSD-3-Clause",
        "its repository",
    ),
}
