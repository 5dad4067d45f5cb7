"""A headless Chromium for tests, by its DevTools protocol over a pipe: needs no driver and no
further package.
"""

from __future__ import annotations

import base64
import io
import itertools
import json
import os
import select
import shutil
import subprocess
import sys
import tempfile
import time

import numpy as np
from PIL import Image

_NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
# SwiftShader draws WebGL without a GPU.
_FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-dev-shm-usage",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--no-first-run",
    "--disable-extensions",
    "--disable-background-networking",
    "--disable-component-update",
    "--remote-debugging-pipe",
)
# The browser reads commands from descriptor 3 and writes to 4.
_START = """
import fcntl, os, sys
ends = [fcntl.fcntl(int(number), fcntl.F_DUPFD, 10) for number in sys.argv[1:3]]
os.dup2(ends[0], 3)
os.dup2(ends[1], 4)
os.execv(sys.argv[3], sys.argv[3:])
"""
_SECONDS = 120  # for one answer; drawing without a GPU on a loaded machine is slow


def find_chromium():
    return next(filter(None, map(shutil.which, _NAMES)), None)


class Chromium:
    """A running browser; close it after use."""

    def __init__(self, binary, *flags):
        self._folder = tempfile.mkdtemp(prefix="chromium-")
        (out, self._send) = os.pipe()
        (self._receive, into) = os.pipe()
        command = [binary, *_FLAGS, *flags, f"--user-data-dir={self._folder}", "about:blank"]
        self._process = subprocess.Popen(
            [sys.executable, "-c", _START, str(out), str(into), *command],
            pass_fds=(out, into),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(out)
        os.close(into)
        self._ids = itertools.count(1)
        self._buffer = b""
        self._listeners = {}

    def open(self, url, width=1280, height=800, before=""):
        """Open a page in a tab of this size, px, and wait until it is loaded; ``before`` is a
        script to run first.
        """
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        page = Page(self, target, session)
        for domain in ("Page", "Network", "Runtime", "Log"):
            page.call(f"{domain}.enable")
        page.call(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=width < 600,
        )
        page.call("Page.addScriptToEvaluateOnNewDocument", source=before)
        page.call("Page.navigate", url=url)
        page.wait("document.readyState === 'complete'")
        return page

    def call(self, method, session=None, **params):
        number = next(self._ids)
        message = {"id": number, "method": method, "params": params} | (
            {"sessionId": session} if session else {}
        )
        os.write(self._send, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._next()
            if answer.get("id") == number:
                if "error" in answer:
                    raise RuntimeError(f"{method}: {answer['error']}")
                return dict(answer["result"])

    def events(self, session):
        return self._listeners.get(session, [])

    def _next(self):
        end = time.monotonic() + _SECONDS
        while b"\0" not in self._buffer:
            ready, _, _ = select.select([self._receive], [], [], max(0.0, end - time.monotonic()))
            part = os.read(self._receive, 1 << 20) if ready else b""
            if not part:
                raise RuntimeError(
                    "Chromium has ended" if ready else f"Chromium gave no answer in {_SECONDS} s"
                )
            self._buffer += part
        text, _, self._buffer = self._buffer.partition(b"\0")
        message = json.loads(text)
        if "method" in message:
            self._listeners.setdefault(message.get("sessionId", ""), []).append(message)
        return message

    def close(self):
        os.close(self._send)
        try:
            self._process.wait(10)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        os.close(self._receive)
        shutil.rmtree(self._folder, ignore_errors=True)


class Page:
    """A tab of the browser."""

    def __init__(self, browser, target, session):
        self._browser = browser
        self._target = target
        self._session = session

    def call(self, method, **params):
        return self._browser.call(method, self._session, **params)

    def evaluate(self, expression):
        """Return the value of a JavaScript expression, or of its promise."""
        answer = self.call(
            "Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True
        )
        if "exceptionDetails" in answer:
            raise RuntimeError(str(answer["exceptionDetails"]))
        return answer["result"].get("value")

    def wait(self, expression, seconds=_SECONDS):
        """Wait until an expression is true, on this page or on one that it goes to meanwhile."""
        end = time.monotonic() + seconds
        while not self._holds(expression):
            if time.monotonic() > end:
                raise RuntimeError(f"not true within {seconds:.0f} s: {expression}")
            time.sleep(0.05)

    def _holds(self, expression):
        try:
            return bool(self.evaluate(expression))
        except RuntimeError as error:
            if "Inspected target navigated" in str(error):
                return False
            raise

    def picture(self, selector="body"):
        """Return the pixels of an element (H, W, 3), as they are on the screen."""
        self.evaluate(
            "new Promise(r => requestAnimationFrame(() => requestAnimationFrame(() => r(1))))"
        )
        x, y, width, height = self.box(selector)
        clip = {"x": x, "y": y, "width": width, "height": height, "scale": 1}
        data = self.call("Page.captureScreenshot", format="png", clip=clip)["data"]
        return np.array(Image.open(io.BytesIO(base64.b64decode(data))).convert("RGB"))

    def box(self, selector):
        """Return x, y, width and height of an element, px."""
        code = (
            "(r => [r.x, r.y, r.width, "
            "r.height])(document.querySelector(%s).getBoundingClientRect())"
        )
        return self.evaluate(code % json.dumps(selector))

    def _mouse(self, kind, x, y, **more):
        self.call("Input.dispatchMouseEvent", type=f"mouse{kind}", x=x, y=y, **more)

    def click(self, x, y):
        self.drag((x, y), (x, y))

    def drag(self, start, end, button="left"):
        """Move the mouse from one place to another, px; the pressed button is "left" or "right"."""
        pressed = {"button": button, "buttons": 1 if button == "left" else 2, "clickCount": 1}
        self._mouse("Moved", *start)
        self._mouse("Pressed", *start, **pressed)
        if start != end:
            self._mouse("Moved", (start[0] + end[0]) / 2, (start[1] + end[1]) / 2)
            self._mouse("Moved", *end)
        self._mouse("Released", *end, **pressed)

    def turn_wheel(self, x, y, amount):
        """Turn the wheel of the mouse at a place, px; a positive amount scrolls down."""
        self._mouse("Wheel", x, y, deltaX=0, deltaY=amount)

    def press(self, key):
        codes = {"Tab": 9, "Enter": 13, " ": 32, "Escape": 27, "ArrowLeft": 37, "ArrowUp": 38}
        text = {" ": " ", "Enter": "\r"}.get(key, key if len(key) == 1 else "")
        common = {
            "key": key,
            "code": "Space" if key == " " else key,
            "windowsVirtualKeyCode": codes.get(key, 0),
        }
        self.call(
            "Input.dispatchKeyEvent", type="keyDown", **common, **({"text": text} if text else {})
        )
        self.call("Input.dispatchKeyEvent", type="keyUp", **common)

    def requests(self):
        """Return the addresses that the page has asked for, but for data in the page itself."""
        sent = (
            e["params"]
            for e in self._browser.events(self._session)
            if e["method"] == "Network.requestWillBeSent"
        )
        return [
            p["request"]["url"]
            for p in sent
            if not p["request"]["url"].startswith(("data:", "blob:"))
        ]

    def errors(self):
        """Return what the page has reported as errors: exceptions, console and log."""
        found = []
        for event in self._browser.events(self._session):
            params = event["params"]
            if event["method"] == "Runtime.exceptionThrown":
                found.append(str(params["exceptionDetails"]))
            elif event["method"] == "Runtime.consoleAPICalled" and params["type"] == "error":
                found.append(str(params["args"]))
            elif event["method"] == "Log.entryAdded" and params["entry"]["level"] == "error":
                found.append(params["entry"]["text"])
        return found

    def close(self):
        self._browser.call("Target.closeTarget", targetId=self._target)
