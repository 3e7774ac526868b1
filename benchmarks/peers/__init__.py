"""Comparison with figaroh and mujoco.sysid: injected faults, recordings and findings."""
