"""Identify the pendulum 1r from a noise-free recording: two base parameters to five digits.

`signid data 1r` downloads the recording; its torque is m g d sin q + (I + m d^2) a.
"""

import signid
from signid.identify import Identification
from signid.recording.gallery import recordings

TRUTH = {"mz_1": -2.5, "Iyy_1": 1.67085}  # -m d [kg.m], I + m d^2 [kg.m2]


def main() -> Identification:
    """Identify and compare with the true values."""
    robot = signid.load_robot("1r")
    file = recordings("1r") / "1dof_experiment1.csv.gz"
    options = signid.Options(effects=())  # the simulation had no friction
    result = signid.identify(robot, [signid.read_recording(file, robot)], options=options)
    for expression, value in zip(result.base.expressions, result.base_value, strict=True):
        true = TRUTH.get(expression, 0.0)
        print(f"{expression:6} {value:9.5f}   true {true:9.5f}")
        if abs(value - true) > 2e-5:
            raise SystemExit(f"{expression} differs from its true value")
    return result


if __name__ == "__main__":
    try:
        main()
    except signid.SignidError as error:
        raise SystemExit(str(error)) from None
