"""Selected laws -> what is reported: alternatives, verdict, numbers, intervals, held-out selection."""
