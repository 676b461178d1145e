"""Text that somebody may put into any field to make a report, a terminal or a table do what its reader did not ask."""

import http.server
import os
import pty
import select
import shutil
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

ESCAPE, TURN = "\x1b[31m", "\u202e"
#: What no terminal must get from a name: colours, a window's title, C1 controls, a turn of the line, a bell.
STEERING = (b"\x1b[31m", b"\x1b]0;", b"\xc2\x9b31m", "\u202e".encode(), b"\x07")
ON_TERMINAL = f"a{ESCAPE}b\x1b]0;pwned\x07c\x9b31md{TURN}e"
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")


def in_page(port: int) -> str:
    """Text that calls for a beacon and marks the page in every way that a page may be made to run something."""
    run = f"fetch('http://127.0.0.1:{port}/x');document.documentElement.id='pwned';alert(1)"
    return (
        f"\"'><script>{run}</script></title></style></textarea></script><script>{run}</script>"
        f'<img src="http://127.0.0.1:{port}/i" onerror="{run}"><svg onload="{run}"/><a href="javascript:{run}">a</a>'
        f"<style>@import 'http://127.0.0.1:{port}/s';</style><base href='http://127.0.0.1:{port}/'>"
        f"<meta http-equiv=refresh content='0;url=http://127.0.0.1:{port}/m'><iframe src='http://127.0.0.1:{port}/f'>"
        f'--><!-- &lt;script&gt; ]]> {{{{7*7}}}} {{% raw %}} #read("/etc/passwd") #import "x" $x^2$ \\frac{{ ${{x}} '
        f"**bold** `code` =cmd|'/c calc'!A1 {ESCAPE}{TURN}\x00\u2066 שלום"
    )


def browser() -> str:
    """A browser, or a skip that says what was not looked at."""
    for name in BROWSERS:
        if path := shutil.which(name):
            return path
    return pytest.skip("NOT CHECKED: no chromium or chrome found to open hostile reports in")


@contextmanager
def beacons() -> Iterator[tuple[int, list[str]]]:
    """A port of this machine, and the paths that were asked for there."""
    asked: list[str] = []

    class Listener(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            asked.append(self.path)
            self.send_response(204)
            self.end_headers()

        def log_message(self, *_: object) -> None:
            pass

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Listener) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield server.server_port, asked
        server.shutdown()


def opened(path: Path, scratch: Path) -> tuple[str, str]:
    """The document as a browser has it after some seconds, and what its console and network said."""
    flags = ["--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking", "--disable-sync",
             "--disable-component-update", "--virtual-time-budget=3000", "--enable-logging=stderr", "--v=0",
             "--dump-dom", f"--user-data-dir={scratch / 'profile'}"]  # fmt: skip
    done = subprocess.run([browser(), *flags, path.as_uri()], capture_output=True, check=True, timeout=120)
    said = [line for line in done.stderr.decode(errors="replace").splitlines() if "CONSOLE" in line]
    return done.stdout.decode(errors="replace"), "\n".join(said)


def on_terminal(arguments: list[str], directory: Path) -> tuple[int, bytes]:
    """Exit code of a command on a terminal, and all that the terminal got."""
    leader, follower = pty.openpty()
    process = subprocess.Popen(
        [sys.executable, "-c", "from jointbayes.cli.commands import main; main()", *arguments],
        stdin=follower, stdout=follower, stderr=follower, cwd=directory, env=os.environ | {"TERM": "xterm"},
    )  # fmt: skip
    os.close(follower)
    got = b""
    while True:
        if select.select([leader], [], [], 0.2)[0]:
            try:
                part = os.read(leader, 1 << 16)
            except OSError:  # Linux says so when nobody holds the other end any more
                break
            if not part:
                break
            got += part
        elif process.poll() is not None:
            break
    os.close(leader)
    return process.wait(), got
