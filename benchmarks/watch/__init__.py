"""Contacts and changes of a robot at work: MuJoCo, a real UR10e, and quiet streams."""
