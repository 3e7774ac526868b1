"""Result of `signid check`: one description for torque and for position drives, with its terminal text and JSON."""
