"""Makes the environment known to Gymnasium when it is imported: `gymnasium.make("omniwalk.gym:omniwalk/Walk-v0")`."""

from gymnasium import register

register(
    "omniwalk/Walk-v0", entry_point="omniwalk.environment:Env", vector_entry_point="omniwalk.vector:VectorEnv"
)
