"""A program on a terminal, for tests of what it shows there."""

import fcntl
import os
import pty
import struct
import subprocess
import termios


def on_terminal(command, columns, when=None, then=None):
    """Runs a program whose standard error is a terminal; calls `then` with it once it shows `when`. Returns its exit code, its
    standard output and what it has shown."""
    terminal, end = pty.openpty()
    fcntl.ioctl(end, termios.TIOCSWINSZ, struct.pack("4H", 24, columns, 0, 0))
    program = subprocess.Popen(list(map(str, command)), stdout=subprocess.PIPE, stderr=end, text=True)
    os.close(end)
    shown = b""
    try:
        while chunk := os.read(terminal, 1000):
            if when and when in chunk and when not in shown:
                then(program)
            shown += chunk
    except OSError:  # how Linux says that the program has closed its end
        pass
    finally:
        os.close(terminal)
    out, _ = program.communicate(timeout=300)
    return program.returncode, out, shown
