"""Unknown torque constants of joints that log currents."""
