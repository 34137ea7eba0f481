"""The command `voxspring`: the program that the package brings, and `voxspring study peers`."""

import os
import sys

from .results import PROGRAM


def main() -> None:
    if sys.argv[1:3] == ["study", "peers"]:
        from .peers import main as peers

        sys.exit(peers(sys.argv[3:]))
    os.execv(PROGRAM, [str(PROGRAM), *sys.argv[1:]])


if __name__ == "__main__":
    main()
