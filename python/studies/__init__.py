"""Studies of many runs or evaluations, resumable, one at a time; each keeps a small CSV under runs/ and draws it."""
