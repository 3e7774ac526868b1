"""How sure signs are: confidence, inflation of the noise, flags."""
