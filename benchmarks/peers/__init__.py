"""The same job by others, to be timed beside signid."""
