"""The report on a phone, on paper, in the dark, without colour and without a script, in Chromium."""

import pytest

pytest_plugins = ("report_fixtures",)

PHONE = {"width": 360, "height": 740}

CONTRASTS = """() => {
  const luminance = ([r, g, b]) => [r, g, b].map(v => v / 255)
    .map(v => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4)
    .reduce((sum, v, i) => sum + v * [0.2126, 0.7152, 0.0722][i], 0);
  const channels = text => text.match(/[\\d.]+/g).map(Number);
  const ground = element => {
    for (let e = element; e; e = e.parentElement) {
      const colour = channels(getComputedStyle(e).backgroundColor);
      if (colour.length === 3 || colour[3] > 0.99) return colour;
    }
    return [255, 255, 255];
  };
  const ratio = (a, b) => {
    const [x, y] = [luminance(a), luminance(b)].sort((p, q) => q - p);
    return (x + 0.05) / (y + 0.05);
  };
  const found = [];
  for (const e of document.querySelectorAll("body *")) {
    const own = [...e.childNodes].some(n => n.nodeType === 3 && n.textContent.trim());
    if (!own || !e.checkVisibility() || e.closest("script, style")) continue;
    const colour = channels(getComputedStyle(e).color);
    found.push([ratio(colour, ground(e)), 4.5, e.tagName + "." + e.className, e.textContent]);
  }
  const shapes = ["line", "inferred", "lost", "posture", "touch", "area"].map(name => `svg .${name}`).join();
  for (const e of document.querySelectorAll(shapes)) {
    if (!e.checkVisibility() || e.classList.contains("light")) continue;
    const style = getComputedStyle(e), paint = style.fill === "none" ? style.stroke : style.fill;
    found.push([ratio(channels(paint), ground(e)), 3, e.tagName + "." + e.className.baseVal, ""]);
  }
  return found.filter(([is, least]) => is < least)
    .map(([is, least, what, text]) => `${is.toFixed(2)} ${what} ${text.slice(0, 40)}`);
}"""


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("which", ["address", "comparison"])
def test_contrast_suffices_for_letters_and_curves(page, request, which, scheme):
    page.emulate_media(color_scheme=scheme)
    page.goto(request.getfixturevalue(which))
    page.locator("#angle-knee_flexion input, .chart input").first.focus()
    assert page.evaluate(CONTRASTS) == []


@pytest.mark.parametrize("which", ["address", "comparison"])
def test_a_phone_scrolls_down_only(page, request, which):
    page.set_viewport_size(PHONE)
    page.goto(request.getfixturevalue(which))
    page.evaluate("document.querySelectorAll('details').forEach(part => part.open = true)")
    assert page.evaluate("document.documentElement.scrollWidth") <= PHONE["width"]
    small = page.evaluate(
        "[...document.querySelectorAll('a, input, summary')].filter(e => e.checkVisibility() && e.offsetHeight > 0 && "
        "!e.matches('.skip, p > a:not(.csv)')).filter(e => e.getBoundingClientRect().height < 24)"
        ".map(e => e.outerHTML.slice(0, 80))"
    )
    assert small == []  # WCAG 2.2, 2.5.8


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_paper_is_black_on_white_and_shows_all_without_what_needs_a_mouse(page, address, scheme):
    page.emulate_media(media="print", color_scheme=scheme)
    page.goto(address)
    look = "getComputedStyle(document.body)"
    assert page.evaluate(f"[{look}.color, {look}.backgroundColor]") == ["rgb(0, 0, 0)", "rgb(255, 255, 255)"]
    assert page.locator("input").first.is_hidden()
    assert page.locator("#joint-Head").is_visible()  # in a part that is folded on a screen


def test_without_a_script_the_curves_are_there_and_no_slider_pretends(chromium, address):
    context = chromium.new_context(java_script_enabled=False)
    page = context.new_page()
    page.goto(address)
    line = page.locator("#angle-knee_flexion path.line.left.thick")
    assert line.get_attribute("d").startswith("M0 ")
    assert page.locator("#angle-knee_flexion input").is_hidden()
    assert page.locator("noscript").count() == 1
    context.close()
