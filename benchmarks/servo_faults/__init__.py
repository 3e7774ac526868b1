"""Are faults of position drives named, from commands and positions alone?"""
