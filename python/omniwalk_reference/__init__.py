"""Independent readings of a robot folder and of a policy file, to check the Rust side against.

Nothing here shares code with the Rust crates. `robot` reads the folder, `mjcf` writes it as a MuJoCo model;
`python -m omniwalk_reference mjcf ROBOT` prints that model. `policy_file` reads a policy, `walker` runs its loop in double
precision. Units are SI and radians; frames are the URDF's.
"""
