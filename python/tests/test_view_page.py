"""The page of `omniwalk view` in headless Chromium. `--pictures DIR` keeps what it looked like."""

import re
import shutil
import time

import pytest

from viewing import POLICY, viewing

playwright = pytest.importorskip("playwright.sync_api")
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine (Debian: apt install chromium)")

# No graphics card is needed, and nothing is looked up elsewhere.
FLAGS = [
    *("--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update"),
    *("--disable-sync", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"),
]
DESK, PHONE = {"width": 1280, "height": 800}, {"width": 390, "height": 844}
PATIENCE = 120.0


@pytest.fixture(scope="module")
def browser():
    with playwright.sync_playwright() as tools:
        browser = tools.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield browser
        browser.close()


@pytest.fixture
def pictures(request, tmp_path):
    folder = request.config.getoption("--pictures")
    return tmp_path if folder is None else request.config.invocation_params.dir / folder


class Page:
    """The page of `view` in a window, with what went wrong in it."""

    def __init__(self, browser, view, size, scheme="light", touch=False):
        self.context = browser.new_context(viewport=size, color_scheme=scheme, has_touch=touch)
        self.tab, self.wrong, self.elsewhere = self.context.new_page(), [], []
        self.tab.on("console", lambda message: self.wrong.append(message.text) if message.type in ("error", "warning") else None)
        self.tab.on("pageerror", lambda error: self.wrong.append(str(error)))
        self.tab.on("request", lambda asked: self.elsewhere.append(asked.url) if f":{view.port}/" not in asked.url else None)
        self.tab.goto(view.address)

    def __enter__(self):
        return self

    def __exit__(self, *error):
        # What Chromium says of software rendering is not the page's fault.
        wrong = [text for text in self.wrong if "GPU stall" not in text and "GL Driver Message" not in text]
        self.context.close()
        if error == (None, None, None):
            assert wrong == []
            assert [url for url in self.elsewhere if not url.startswith(("data:", "blob:"))] == []

    def text(self, what: str) -> str:
        return self.tab.locator(what).inner_text()

    def place(self) -> tuple[float, float]:
        numbers = re.findall(r"-?\d+\.\d+", self.text("#place"))
        return tuple(map(float, numbers)) if len(numbers) == 2 else (0.0, 0.0)

    def wait(self, holds):
        end = time.monotonic() + PATIENCE
        while not holds():
            assert time.monotonic() < end, self.text("#state")
            self.tab.wait_for_timeout(100)

    def walks(self):
        self.wait(lambda: self.text("#state").startswith("walking") and self.text("#forward"))

    def picture(self, path):
        self.tab.screenshot(path=path)
        assert path.stat().st_size > 20_000


def test_it_drives_pushes_records_and_plays(browser, pictures, tmp_path):
    with viewing(POLICY, "--out", tmp_path / "recordings") as view, Page(browser, view, DESK) as page:
        page.walks()
        start = page.place()
        page.tab.locator("#record").click()
        page.wait(lambda: page.text("#record").startswith("Stop"))
        page.tab.keyboard.down("KeyW")
        page.wait(lambda: page.place()[0] > start[0] + 1.0)
        page.picture(pictures / "view-drive.png")

        # The robot is in the middle of what the panel leaves.
        canvas = page.tab.locator("#scene")
        page.tab.locator("#strength").fill("40")
        canvas.click(position={"x": (DESK["width"] - 312) / 2, "y": DESK["height"] / 2})
        here = page.place()
        page.wait(lambda: page.place()[0] > here[0] + 0.6)
        page.tab.keyboard.up("KeyW")
        assert page.text("#state").startswith("walking") and "fall" not in page.text("#state")

        page.tab.locator("#record").click()
        page.wait(lambda: page.tab.locator("#source option").count() == 2)
        rows = view.rows(0)
        assert max(row["x"] for row in rows) > start[0] + 1.5
        page.tab.locator("#source").select_option("0")
        page.wait(lambda: page.tab.locator("#player").is_visible() and page.place() != (0.0, 0.0))
        page.tab.locator("#play").click()
        page.tab.locator("#scrub").fill("0.5")
        middle = rows[len(rows) // 2]
        page.wait(lambda: abs(page.place()[0] - middle["x"]) < 0.1)
        # Two decimals: 7.125 is 7.12 in Python and 7.13 in the browser.
        shown = float(page.text("#time").split("/")[1].removesuffix("s"))
        assert shown == pytest.approx(rows[-1]["time"], abs=0.00501)
        page.picture(pictures / "view-play.png")


def test_a_push_by_a_click_reaches_the_robot(browser, tmp_path):
    with viewing(POLICY, "--out", tmp_path) as view, Page(browser, view, DESK) as page, view.drive() as drive:
        page.walks()
        page.tab.locator("#strength").fill("30")
        page.tab.locator("#scene").click(position={"x": (DESK["width"] - 312) / 2, "y": DESK["height"] / 2})
        row = drive.next("row", lambda row: row["push_x"] or row["push_y"])
        assert (row["push_x"] ** 2 + row["push_y"] ** 2) ** 0.5 == pytest.approx(30.0, abs=0.01)
        # Beside the robot there is nothing to push, and turning the view is no push.
        page.tab.locator("#scene").click(position={"x": 200, "y": 300})
        drive.next("row", lambda row: row["push_x"] == row["push_y"] == 0.0)
        times = [drive.next("row") for _ in range(40)]
        assert all(row["push_x"] == row["push_y"] == 0.0 for row in times)


def test_it_fits_a_phone_and_a_stick_drives(browser, pictures, tmp_path):
    with viewing(POLICY, "--out", tmp_path) as view, Page(browser, view, PHONE, scheme="dark", touch=True) as page:
        page.walks()
        width = page.tab.evaluate("document.documentElement.scrollWidth")
        assert width <= PHONE["width"]
        for part in ("header", "#drive", "#walk", "#twist", "#push", "#stand", "#record"):
            box = page.tab.locator(part).bounding_box()
            assert box["x"] >= 0 and box["x"] + box["width"] <= PHONE["width"] and box["y"] + box["height"] <= PHONE["height"], part
        stick = page.tab.locator("#walk").bounding_box()
        middle = (stick["x"] + stick["width"] / 2, stick["y"] + stick["height"] / 2)
        page.tab.mouse.move(*middle)
        page.tab.mouse.down()
        page.tab.mouse.move(middle[0], middle[1] - 25)
        with view.drive() as drive:
            row = drive.next("row", lambda row: row["velocity_x"] > 0.1 and row["command_x"] > 0.2, PATIENCE)
            assert abs(row["command_y"]) < 0.05
        page.picture(pictures / "view-phone.png")
        page.tab.mouse.up()
        page.tab.locator("#details").click()
        assert page.tab.locator("#conditions").is_visible()


def test_a_gamepad_drives(browser, tmp_path):
    with viewing(POLICY, "--out", tmp_path) as view, Page(browser, view, DESK) as page, view.drive() as drive:
        page.walks()
        # No machine of the tests has one: the browser says that one is there, with its left stick forward and its right one to the left.
        pad = "{connected: true, axes: [0, -0.8, -0.5, 0]}"
        page.tab.evaluate(f"navigator.getGamepads = () => [null, {pad}]")
        asked = pytest.approx([0.8 * 0.6, 0.0, 0.5 * 0.6], abs=1e-3)
        row = drive.next("row", lambda row: [row[f"command_{axis}"] for axis in ("x", "y", "turn")] == asked, PATIENCE)
        drive.next("row", lambda row: row["velocity_x"] > 0.2 and row["velocity_turn"] > 0.1, PATIENCE)
        # What a stick at rest shows is nothing, and one that is unplugged lets go.
        page.tab.evaluate("navigator.getGamepads = () => [{connected: true, axes: [0.1, 0.1, -0.1, 0]}]")
        drive.next("row", lambda row: row["command_x"] == row["command_turn"] == 0.0, PATIENCE)
        page.tab.evaluate(f"navigator.getGamepads = () => [{pad}]")
        drive.next("row", lambda row: row["command_x"] > 0.0, PATIENCE)
        page.tab.evaluate("navigator.getGamepads = () => [null]")
        drive.next("row", lambda row: row["command_x"] == 0.0, PATIENCE)


def test_without_the_token_the_page_says_what_to_do(browser, tmp_path):
    with viewing(POLICY, "--out", tmp_path) as view:
        tab = browser.new_page()
        tab.goto(f"http://{view.host}:{view.port}/")
        # Not `wait_for_function`: it evaluates a string again and again, which the page's policy forbids.
        tab.locator("#state", has_text="token").wait_for()
        tab.close()
