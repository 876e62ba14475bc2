"""Random streams: one `SeedSequence` per run, keyed by what is drawn for and split by stage."""

import hashlib
import json

import numpy as np


def stream(stage: str, *key: object) -> np.random.Generator:
    """A generator that depends on the stage and the key (strings and numbers) and nothing else.

    Equal keys give equal streams in any process on any machine; different ones independent ones.
    """
    document = json.dumps([stage, *key], separators=(",", ":")).encode()
    words = np.frombuffer(hashlib.sha256(document).digest(), dtype="<u4")
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(words.tolist())))
