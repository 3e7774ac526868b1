"""Recovery of torque signs from absolute torque."""
