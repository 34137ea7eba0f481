"""A program on a terminal, for tests of what it shows there."""

import os
import pty
import subprocess
import termios


def on_terminal(command, columns, when=None, then=None, stream="stderr", env=None):
    """Runs a program that has a terminal for a stream, its standard error unless `stream` is "stdout"; calls `then` with it once it
    shows `when`. Returns its exit code, its standard output if that is no terminal, and what it has shown."""
    terminal, end = pty.openpty()
    termios.tcsetwinsize(end, (24, columns))
    program = subprocess.Popen(list(map(str, command)), text=True, env=env, **{"stdout": subprocess.PIPE, stream: end})
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
