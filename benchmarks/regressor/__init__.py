"""Speed of base-parameter identification: one job for signid, Pinocchio and figaroh."""
