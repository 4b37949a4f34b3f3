"""Print the path of the libzmq inside of pyzmq, for programs that are built without another."""

import sys
from pathlib import Path

import zmq

found = sorted((Path(zmq.__file__).parents[1] / "pyzmq.libs").glob("libzmq-*"))
if not found:
    sys.exit("this pyzmq brings no libzmq: install the one of your system")
print(found[0])
