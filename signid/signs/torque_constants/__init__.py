"""Unknown torque constants of joints that record currents."""
