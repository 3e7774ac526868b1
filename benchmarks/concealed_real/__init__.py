"""Known changes of identified models and of real recordings, diagnosed: names, numbers, and whether they generalise."""
