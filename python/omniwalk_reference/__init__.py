"""The robot in MuJoCo: an independent reading of a robot folder, to check the Rust side against.

Nothing here shares code with the Rust crates. `robot` reads the folder, `mjcf` writes it as a MuJoCo model;
`python -m omniwalk_reference mjcf ROBOT` prints that model. Units are SI and radians; frames are the URDF's.
"""
