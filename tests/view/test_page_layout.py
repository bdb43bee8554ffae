"""The layout, colours and names of the page, with a server of synthetic data."""

import re
from pathlib import Path

from mock_page import FROZEN

PROTOCOL = Path(__file__).resolve().parents[2] / "docs" / "view-protocol.md"
SIZES = [(1280, 720), (1920, 1080), (1024, 768)]
TABS = ["camera", "scene", "noise", "measure", "save"]


def test_layout(mock_page):
    page = mock_page(*FROZEN)
    for width, height in SIZES:
        page.size(width, height)
        for tab in TABS:
            page.tab(tab)
            page.settle()
            found = page.js("""const d = document.documentElement; const out = [];
                if (d.scrollWidth > innerWidth || d.scrollHeight > innerHeight) out.push('page scrolls');
                for (const p of document.querySelectorAll('.panel:not([hidden])')) if (p.scrollWidth > p.clientWidth) out.push('panel ' + p.id);
                for (const e of document.querySelectorAll('button, select, input, label, h2, dt, dd')) {
                  const r = e.getBoundingClientRect(); if (r.width === 0 || e.closest('[hidden], dialog')) continue;
                  if (r.right > innerWidth + 1 || r.left < -1) out.push(e.id || e.textContent);
                  if (e.matches('button, h2') && e.scrollWidth > e.clientWidth + 1) out.push('cut: ' + (e.id || e.textContent)); }
                const v = document.getElementById('verdict'); for (const p of v.querySelectorAll('p')) if (p.scrollHeight > p.clientHeight + 1) out.push('cut: ' + p.id + ' ' + p.textContent);
                return out""")
            assert not found, (width, height, tab, found)
    # Values that change move nothing.
    places = "return [...document.querySelectorAll('button, select, input, dt, h2')].filter(e => !e.closest('[hidden], dialog')).map(e => { const r = e.getBoundingClientRect(); return [e.id, r.left, r.top, r.width, r.height] })"
    cut = """return ['verdict-name', 'verdict-text', 'verdict-time', 'target-time', 'target-meaning'].filter(id => {
        const e = document.getElementById(id); return e.clientHeight > 0 && e.scrollHeight > e.clientHeight + 1 }).map(id => document.getElementById(id).textContent)"""
    page.tab("noise")
    for width, height in SIZES:
        page.size(width, height)
        for frozen, target in [(0.5, 0.05), (1.2, 0.05), (18.4, 0.35), (118, 0.05), (118, 0.35), (130, 0.05)]:
            page.set("target", target)
            page.hold(frozen)
            assert not page.js(cut), (width, frozen, page.js(cut))
    page.set("target", 0.5)
    for tab, (width, height) in [(tab, size) for size in SIZES[::2] for tab in TABS]:
        page.size(width, height)
        page.tab(tab)
        page.hold(1.2)
        before = page.js(places)
        page.mouse((300, 300))
        page.hold(119)
        page.keys("n")
        page.settle()
        assert page.js(places) == before, (tab, [pair for pair in zip(before, page.js(places)) if pair[0] != pair[1]])


CONTRAST = """
const paint = document.createElement('canvas').getContext('2d', {willReadFrequently: true});
const rgba = (colour) => { paint.clearRect(0, 0, 1, 1); paint.fillStyle = colour; paint.fillRect(0, 0, 1, 1); return [...paint.getImageData(0, 0, 1, 1).data]; };
const back = (e) => { for (let p = e; p; p = p.parentElement) { const c = rgba(getComputedStyle(p).backgroundColor); if (c[3] > 200) return c; } return [255, 255, 255, 255]; };
const light = (c) => { const [r, g, b] = c.slice(0, 3).map(v => v / 255).map(v => v <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4); return 0.2126 * r + 0.7152 * g + 0.0722 * b; };
const out = [];
for (const e of document.querySelectorAll('body *')) {
  if (e.closest('[hidden], dialog:not([open])') || e.matches(':disabled, option') || e.getBoundingClientRect().width < 2) continue;
  const own = [...e.childNodes].some(n => n.nodeType === 3 && n.textContent.trim() !== '') || e.matches('input, select');
  if (!own) continue;
  const style = getComputedStyle(e);
  const text = light(rgba(e instanceof SVGElement ? style.fill : style.color)), ground = light(back(e));
  const ratio = (Math.max(text, ground) + 0.05) / (Math.min(text, ground) + 0.05);
  if (ratio < 4.5) out.push([e.id || e.className.baseVal || e.className || e.tagName, e.textContent.slice(0, 30), ratio]);
}
return out;
"""


def test_contrast(mock_page):
    page = mock_page(*FROZEN)
    page.set("map", "samples")
    page.set("region1", "10 10 60 60")
    page.set("line", "10 10 60 60")
    page.click("transfer-on")
    for dark in [False, True]:
        page.size(1280, 720, dark)
        page.click("notes-open")
        for tab in TABS:
            page.tab(tab)
            page.settle()
            found = page.js(CONTRAST)
            assert not found, ("dark" if dark else "light", tab, found)
    page.click("help-open")
    assert not page.js(CONTRAST)
    page.click("help-close")
    # The switch of the colours, and its memory.
    page.size(1280, 720, False)
    colour = "return getComputedStyle(document.body).backgroundColor"
    light = page.js(colour)
    page.keys("d", "d")
    assert page.js(colour) != light and page.text("theme") == "Colours: dark"
    page.refresh()
    assert page.js(colour) != light
    page.keys("d")
    assert page.js(colour) == light


def test_names_and_tooltips(mock_page):
    page = mock_page(*FROZEN)
    found = page.js("""const out = [];
        for (const e of document.querySelectorAll('button, select, input, [role=slider], summary')) {
          const name = e.getAttribute('aria-label') || e.labels?.[0]?.textContent.trim() || e.textContent.trim();
          const help = e.title || e.closest('label')?.title || e.querySelector('title')?.textContent;
          if (!name) out.push('no name: ' + e.id); if (!help) out.push('no tooltip: ' + (e.id || e.outerHTML)); }
        const ids = [...document.querySelectorAll('[id]')].map(e => e.id); const twice = ids.filter((x, i) => ids.indexOf(x) !== i); if (twice.length) out.push('twice: ' + twice);
        for (const l of document.querySelectorAll('label[for]')) if (!document.getElementById(l.htmlFor)) out.push('label for nothing: ' + l.htmlFor);
        return out""")
    assert not found, found
    listed = set(re.findall(r"`#([a-zA-Z0-9-]+)`", PROTOCOL.read_text()))
    present = set(page.js("return [...document.querySelectorAll('[id]')].map(e => e.id)"))
    missing = [id_ for id_ in listed if id_ not in present and not re.search(r"-N(-|$)", id_) and id_ != "target-line"]
    assert not missing, missing
