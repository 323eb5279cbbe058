"""The parameters of the method, their two named settings, and the fingerprint."""

import hashlib
import json
from dataclasses import asdict, dataclass

METHOD_VERSION = 1


@dataclass(frozen=True)
class Parameters:
    """A frozen set of parameters."""

    name: str = "default"

    @property
    def fingerprint(self) -> str:
        """Sixteen hexadecimal digits: a hash of the parameters and of the method version."""
        text = json.dumps({"method": METHOD_VERSION, **asdict(self)}, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]


DEFAULT = Parameters()
PAPER = Parameters(name="paper")
