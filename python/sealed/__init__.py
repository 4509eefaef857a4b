"""Sealed worlds: logs of machines whose faults are known to nobody but the truth file.

Nothing here imports omniwalk: the physics, the effects and the log files are made a second time, in other forms. The walking
machine reads its folder and its policy by `omniwalk_reference`, which does not either.
"""
