"""Detection of recording faults that are planted in the columns of recordings."""
