"""Other people's learner, Stable-Baselines3, on the task of configs/forward.toml: in this project's environment, and in MuJoCo as one
would set it up without this project. They need PyTorch, which is gigabytes: see torch.txt beside this file.

    python3 -m baselines.run --work DIR          in python/: every run, going on where the last call ended
    python3 -m baselines.throughput              steps a second of each, measured in turns
    python3 -m baselines.page                    docs/baselines.md and its pictures from what the two have written
"""
