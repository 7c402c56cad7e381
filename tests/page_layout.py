"""What is wrong with how a page is laid out, seen by a real Chromium at three widths, light and dark."""

import shutil
from time import monotonic
from typing import Any

from playwright.sync_api import Browser, Page

CHROMIUM = shutil.which("chromium")
WIDTHS = (1400, 800, 390)  # a screen, a small window, a phone; pixels
SCHEMES = ("light", "dark")

# All faults of what is visible now, as sentences.
_FAULTS = """
() => {
  const faults = [];
  const named = (element) => {
    const text = element.textContent.trim().replace(/\\s+/g, " ").slice(0, 40);
    return `<${element.tagName.toLowerCase()} class="${element.getAttribute("class") ?? ""}"> ${text}`;
  };
  const root = document.scrollingElement;
  if (root.scrollWidth > innerWidth) faults.push(`the page is ${root.scrollWidth} pixels wide`);
  const visible = [...document.body.querySelectorAll("*")].filter((each) => each.checkVisibility());
  for (const each of visible) {
    // What is wider than its place scrolls there, by keyboard too, and says what it is; nothing is cut off.
    if (each.scrollWidth <= each.clientWidth + 1 || each.clientWidth === 0) continue;
    const overflow = getComputedStyle(each).overflowX;
    if (overflow === "hidden" && !each.closest("header, .stage")) faults.push(`cut off: ${named(each)}`);
    if (overflow !== "auto" && overflow !== "scroll") continue;
    if (each.tabIndex !== 0) faults.push(`scrolls, but not by keyboard: ${named(each)}`);
    if (!each.ariaLabel && each.tagName !== "PRE") faults.push(`scrolls without a label: ${named(each)}`);
  }
  for (const each of visible.filter((one) => one.matches("h1, h2, h3, h4, th, td"))) {
    each.scrollIntoView({ behavior: "instant", block: "center", inline: "center" });
    const box = each.getBoundingClientRect();
    const hit = document.elementFromPoint((box.left + box.right) / 2, (box.top + box.bottom) / 2);
    if (hit === null) faults.push(`out of reach: ${named(each)}`);
    else if (!each.contains(hit) && !hit.contains(each)) faults.push(`${named(hit)} covers ${named(each)}`);
  }
  return faults;
}
"""
# Words of cards, and numbers anywhere, that stand on two lines though one has room for them. The text
# nodes around a <wbr> count as one text, since it divides a word without ending it.
_BROKEN = """
() => {
  const broken = [];
  const range = document.createRange();
  const check = (element, pattern) => {
    if (!element.checkVisibility()) return;
    const nodes = [...element.childNodes].filter((node) => node.nodeType === Node.TEXT_NODE);
    const wbr = (node) => node?.nodeType === Node.ELEMENT_NODE && node.tagName === "WBR";
    while (nodes.length) {
      const run = [nodes.shift()];
      while (nodes.length && wbr(run.at(-1).nextSibling)) run.push(nodes.shift());
      const place = (index) => {
        for (const node of run) {
          if (index <= node.data.length) return [node, index];
          index -= node.data.length;
        }
      };
      for (const word of run.map((node) => node.data).join("").matchAll(pattern)) {
        range.setStart(...place(word.index));
        range.setEnd(...place(word.index + word[0].length));
        const boxes = [...range.getClientRects()].filter((box) => box.width > 0);
        const lines = new Set(boxes.map((box) => Math.round(box.top)));
        const length = boxes.reduce((sum, box) => sum + box.width, 0);
        if (lines.size > 1 && length < element.clientWidth) broken.push(word[0]);
      }
    }
  };
  for (const card of document.querySelectorAll(".tile, .chips li, .claim")) {
    for (const element of [card, ...card.querySelectorAll("*")]) check(element, /[^\\s-]+/g);
  }
  for (const element of document.querySelectorAll("th *, h2, dt")) check(element, /\\d+\\.\\d+/g);
  return broken;
}
"""


def until(page: Page, condition: str) -> None:
    """Wait for a condition in JavaScript; Playwright's own way needs `eval`, which the page forbids."""
    end = monotonic() + 15
    while not page.evaluate(condition):
        assert monotonic() < end, f"never came true: {condition}"
        page.wait_for_timeout(20)


def layout_faults(browser: Browser, address: str) -> list[str]:
    """Everything that is wrong with the page at any width and in either color scheme.

    The page must not be wider than the window; what is wider than its place must scroll there, with a label;
    nothing may lie over a heading or a cell of a table; a card breaks no word; the console stays empty.
    """
    faults: list[str] = []
    context = browser.new_context(reduced_motion="reduce")
    page = context.new_page()
    page.on("console", lambda message: faults.append(f"console: {message.text}"))
    page.on("pageerror", lambda error: faults.append(f"error: {error}"))
    page.goto(address)
    page.evaluate("document.querySelectorAll('details').forEach((each) => (each.open = true))")
    tabs: list[Any] = page.evaluate("[...document.querySelectorAll('nav.tabs a')].map((tab) => tab.hash)")
    for tab in tabs or [""]:
        page.evaluate("(hash) => { location.hash = hash; }", tab)
        for width in WIDTHS:
            for scheme in SCHEMES:
                page.set_viewport_size({"width": width, "height": 900})
                page.emulate_media(color_scheme="dark" if scheme == "dark" else "light")
                page.wait_for_timeout(50)  # for observers of sizes
                found = page.evaluate(_FAULTS)
                found += [f"a word is broken: {word}" for word in page.evaluate(_BROKEN)]
                faults += [f"{tab} {width} {scheme}: {fault}" for fault in found]
    context.close()
    return faults
