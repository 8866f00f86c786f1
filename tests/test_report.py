"""The page draws itself in a browser, without network; its slider moves the object."""

import json
import re
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest

from tactilenlp.errors import OptionError

BROWSER = shutil.which("chromium") or shutil.which("google-chrome")
# What a reader does, and what can be seen then: appended to a copy of the page.
PROBE = """<script>
const shown = () => [...find("scene").getContext("2d").getImageData(
  0, 0, find("scene").width, find("scene").height).data];
const difference = (a, b) => a.reduce((n, value, i) => n + (value !== b[i]), 0);
const start = shown();
const blank = start.every((value) => value === 0);
find("sample").value = 3;
find("sample").dispatchEvent(new Event("input"));
const scrubbed = shown(), sample = root.dataset.sample;
find("scene").dispatchEvent(new PointerEvent("pointermove",
  { buttons: 1, movementX: 60, movementY: 10 }));
const turned = shown();
root.dataset.probe = JSON.stringify({ blank, sample,
  scrubbed: difference(start, scrubbed), turned: difference(scrubbed, turned) });
</script>"""


@pytest.fixture(scope="module")
def page(estimate, tmp_path_factory):
    path = tmp_path_factory.mktemp("report") / "report.html"
    estimate.report(path)
    return path


def content(path):
    text = path.read_text(encoding="utf-8")
    found = re.search(r'<script id="data"[^>]*>(.*?)</script>', text, re.S)
    return json.loads(found.group(1))


def browse(path, *flags):
    """Return the page as a headless browser leaves it."""
    if BROWSER is None:
        pytest.skip("no chromium on this machine")
    done = subprocess.run(
        [BROWSER, "--headless", "--no-sandbox", "--disable-gpu", "--dump-dom", *flags,
         "--host-resolver-rules=MAP * ~NOTFOUND", path.as_uri()],
        capture_output=True, text=True, timeout=120,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_browser_draws_it_without_errors_and_the_slider_moves_the_object(page):
    probed = page.with_name("probed.html")
    probed.write_text(page.read_text(encoding="utf-8") + PROBE, encoding="utf-8")
    dom = browse(probed)
    assert "data-error" not in dom
    probe = json.loads(
        re.search(r'data-probe="(.*?)"', dom).group(1).replace("&quot;", '"')
    )
    assert not probe["blank"]
    assert probe["sample"] == "3"
    assert probe["scrubbed"] > 1000  # values of pixels that changed
    assert probe["turned"] > 1000


def test_the_words_of_the_summary_are_on_the_page(page, estimate):
    dom = browse(page)
    assert estimate.status in dom
    for words in estimate.remarks:
        assert words in dom
    for name in estimate.costs:
        assert name in dom


def test_it_needs_nothing_from_elsewhere(page):
    text = page.read_text(encoding="utf-8")
    assert "{{" not in text
    assert not re.search(r"""(src|href)\s*=|https?://|@import|url\(|fetch\(""", text)


def test_the_report_shows_the_numbers_of_the_estimate(page, estimate):
    shown, data = content(page), estimate.measurements
    np.testing.assert_allclose(shown["position"], estimate.position, atol=1e-5)
    np.testing.assert_allclose(shown["quaternion"], estimate.quaternion, atol=1e-6)
    assert shown["finger"][0]["contact"] == data.contact[:, 0].tolist()
    assert sum(value for _, value in shown["costs"]) == pytest.approx(
        estimate.objective
    )
    side = 1e3 * estimate.side_lengths[0]
    sigma = 1e3 * estimate.information.sigma("side_lengths")[0]
    assert shown["sigma"][0] == ["side x", f"{side:.2f} ± {sigma:.2f} mm"]
    assert shown["skipped"] == [str(skipped) for skipped in estimate.skipped]
    assert shown["remarks"] == estimate.remarks
    assert set(estimate.remarks) <= set(estimate.summary().split("\n"))
    assert shown["fit"]["verdict"] == estimate.fit.verdict
    total = [row for row in shown["fit"]["rows"] if row[0] == "all terms"]
    assert total[0][1] == f"{estimate.fit.actual:.1f}"


def test_it_shows_the_largest_error_of_each_quantity(page, estimate, tmp_path):
    errors = estimate.information.error_budget("side_lengths")
    sigma = np.array([*errors.values()])
    rows = [name for name, _ in content(page)["sigma"]]
    told = rows[rows.index("side z") + 1]
    assert told.startswith("largest error: ")
    for axis, worst in zip("xyz", sigma.argmax(axis=0), strict=True):
        assert axis in re.search(rf"{[*errors][worst]} \((.*?)\)", told)[1]
    before = replace(estimate.information, budget={})  # of an older file
    replace(estimate, information=before).report(tmp_path / "report.html")
    shown = [name for name, _ in content(tmp_path / "report.html")["sigma"]]
    assert shown == [name for name in rows if not name.startswith("largest error")]


def test_each_of_seven_fingers_has_its_colour_impulse_and_room(estimate, tmp_path):
    data, (first, second) = estimate.measurements, ("finger 0", "finger 1")
    fingers = np.arange(7) % 2
    names = ("finger_position", "contact", "normal", "valid")
    many = {name: getattr(data, name)[:, fingers] for name in names}
    data = replace(data, finger_radius=data.finger_radius[fingers], **many)
    pushes = [estimate.impulses[(first, second)[f]] for f in fingers]
    pushes = {f"finger {f}": (1 + f) * push for f, push in enumerate(pushes)}
    path = tmp_path / "report.html"
    replace(estimate, measurements=data, impulses=pushes).report(path)
    shown = content(path)["finger"]
    assert len({tuple(finger["colour"]) for finger in shown}) == 7
    for finger, push in zip(shown, pushes.values(), strict=True):
        np.testing.assert_allclose(finger["impulse"], push, atol=1e-5)
    height = re.search(r'id="touch"[^>]*height: (\d+)px', browse(path))
    assert int(height[1]) > 7 * 62  # pixels of a chart beside its words


def test_touched_points_lie_on_the_surface(page, estimate):
    points = np.array([touch["point"] for touch in content(page)["touches"]])
    beyond = (abs(points) - estimate.side_lengths / 2).max(axis=1)
    assert abs(beyond).max() < 1e-3  # residuals of the fit, rounded to 10 um


def test_words_from_a_file_cannot_become_a_script(estimate, tmp_path):
    hostile = replace(estimate, status="</script><script>alert(1)</script>")
    hostile.report(tmp_path / "report.html")
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "<script>alert" not in text
    assert text.count("</script>") == 2


def test_no_ground_and_what_was_fixed_are_shown_as_such(estimate, tmp_path):
    known = replace(estimate.information, ground=None)
    scene = replace(estimate.scene, ground=None)
    blank = replace(estimate, scene=scene, information=known)
    blank.report(tmp_path / "report.html")
    shown = content(tmp_path / "report.html")
    assert shown["grid"] == []
    assert ["rotation about x", "fixed by a reduction"] in shown["sigma"]


def test_the_turn_about_the_vertical_is_that_of_the_summary(page, estimate):
    (turn,) = (words for name, words in content(page)["sigma"] if name.endswith("z")
               and name.startswith("rotation"))  # fmt: skip
    assert f"turned by {turn} about the vertical" in estimate.summary()


def test_a_report_is_written_as_html_alone(estimate, tmp_path):
    with pytest.raises(OptionError, match="no such format"):
        estimate.report(tmp_path / "report.png")
    assert not [*tmp_path.iterdir()]


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_cost_that_is_not_finite_is_null_and_shown_as_such(value, estimate, tmp_path):
    name, path = [*estimate.costs][-1], tmp_path / "report.html"
    replace(estimate, costs={**estimate.costs, name: value}).report(path)
    shown = content(path)["costs"]
    assert shown[0] == [name, None]  # first, as what went wrong
    rest = [abs(cost) for _, cost in shown[1:]]
    assert rest == sorted(rest, reverse=True)


def test_a_deviation_that_is_not_known_is_not_shown_as_zero(estimate, tmp_path):
    along = estimate.information.path.copy()
    along[0, 0], along[-1, 2] = np.nan, np.inf
    unknown = replace(estimate.information, path=along)
    path = tmp_path / "report.html"
    replace(estimate, information=unknown).report(path)
    sigma = content(path)["position_sigma"]
    assert sigma[0][0] is None
    assert sigma[-1][2] is None
    assert sigma[0][1] == pytest.approx(along[0, 1], abs=1e-6)


def test_a_browser_shows_what_is_not_finite_in_words(estimate, tmp_path):
    name, path = [*estimate.costs][-1], tmp_path / "report.html"
    along = np.full_like(estimate.information.path, np.nan)
    unknown = replace(estimate.information, path=along)
    costs = {**estimate.costs, name: np.nan}
    replace(estimate, costs=costs, information=unknown).report(path)
    dom = browse(path)
    assert "data-error" not in dom
    assert "not finite" in dom
    assert "± unknown" in dom
