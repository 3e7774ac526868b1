"""Identify the EMPS prismatic drive (Janot, Gautier, Brunot, 2019): mass and friction against published values.

`signid data emps` downloads the recordings.
"""

import signid
from signid.identify import Identification
from signid.recording.gallery import recordings

PUBLISHED = {  # least squares on the inverse dynamics, from the description of the benchmark
    "m_1 + armature_1": 95.1089,  # kg
    "viscous_friction_1": 203.5034,  # N.s/m
    "coulomb_friction_1": 20.3935,  # N
    "torque_offset_1": -3.1648,  # N
}


def main() -> Identification:
    """Identify, compare with the published values, and hold out the run with added pulses."""
    folder = recordings("emps")
    robot = signid.load_robot("emps")
    train, held_out = (signid.read_recording(folder / f"emps_{name}.csv.gz", robot) for name in ("train", "pulses"))
    result = signid.identify(robot, [train], held_out=[held_out])
    for expression, value in zip(result.base.expressions, result.base_value, strict=True):
        print(f"{expression:20} {value:9.4f}  published {PUBLISHED[expression]:9.4f}")
        if abs(value / PUBLISHED[expression] - 1) > 0.01:
            raise SystemExit(f"{expression} is more than 1 % from the published value")
    return result


if __name__ == "__main__":
    try:
        main()
    except signid.SignidError as error:
        raise SystemExit(str(error)) from None
