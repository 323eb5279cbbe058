"""`make audit`: whether any locked package has a known vulnerability, asked of the Python package index.

It ends with 1 when one has, or when it cannot be told; with 0 when none has, and also when the advisories
cannot be reached, since that says nothing of the packages. An index that holds no advisories, as a mirror may
be, knows none of the packages either: pip-audit then says that no vulnerability is known.
"""

import json
import re
import subprocess
import sys
from pathlib import Path

UNREACHED = re.compile(r"\b(ConnectionError|ConnectTimeout|ReadTimeout|ProxyError)\b|Could not connect")


def judge(output: str, errors: str) -> tuple[int, str]:
    """The verdict on pip-audit's JSON and its messages: an exit status, and the text to print."""
    try:
        packages = json.loads(output)["dependencies"]
    except (ValueError, KeyError, TypeError):
        last = errors.strip().splitlines()[-1] if errors.strip() else "no message"
        if UNREACHED.search(last):
            return 0, f"Not audited: the advisories cannot be reached. {last}"
        return 1, f"Not audited: {last}"
    found = [
        f"{package['name']} {package['version']}: {advisory['id']}, repaired in "
        f"{', '.join(advisory['fix_versions']) or 'no version'}"
        for package in packages
        for advisory in package.get("vulns", [])
    ]
    skipped = [
        f"{package['name']}: {package['skip_reason']}" for package in packages if "vulns" not in package
    ]
    if found or (skipped and len(skipped) < len(packages)):
        return 1, "\n".join([*found, *skipped])
    if skipped or not packages:
        return 0, "Not audited: the index that answers holds no advisories."
    return 0, f"{len(packages)} packages, none with a known vulnerability."


def main(lock: str) -> int:
    command = [Path(sys.executable).with_name("pip-audit"), "--requirement", lock, "--format", "json"]
    options = ["--disable-pip", "--require-hashes", "--progress-spinner", "off"]
    done = subprocess.run([*command, *options], capture_output=True, text=True, check=False)
    status, said = judge(done.stdout, done.stderr)
    print(said)
    return status


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
