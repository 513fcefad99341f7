"use strict";
// Brush over the drawings of samples: those outside fade at once, and what was chosen becomes the ranges of the form.
(function () {
  const form = document.getElementById("asked");
  if (!form) return;
  const place = (svg, event) => new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
  const clamp = (x) => Math.min(Math.max(x, 0), 1);
  const axes = () => [...document.querySelectorAll(".parallel [data-axis]")];
  const box = (rect, x, y, width, height) => {
    for (const [name, value] of Object.entries({ x, y, width, height })) rect.setAttribute(name, value);
  };
  const fade = (ranges) => { // ranges: [axis, least, most] in shares of the axes
    const off = new Set();
    for (const line of document.querySelectorAll(".parallel polyline")) {
      const at = line.dataset.at.split(",").map((text) => (text === "" ? NaN : Number(text)));
      if (!ranges.every(([axis, least, most]) => at[axis] >= least && at[axis] <= most)) off.add(line.dataset.sample);
    }
    for (const mark of document.querySelectorAll("[data-sample]")) mark.classList.toggle("off", off.has(mark.dataset.sample));
  };
  const field = (kind, name) => [...form.elements].find((each) => each.name === `${kind}.${name}`);
  const choose = (ranges) => {
    for (const [axis, least, most] of ranges) {
      const { name, least: low, most: high } = axes()[axis].dataset;
      const value = (share) => Number((Number(low) + share * (high - low)).toPrecision(5));
      field("least", name).value = least > 0 ? value(least) : "";
      field("most", name).value = most < 1 ? value(most) : "";
    }
    form.dispatchEvent(new Event("change", { bubbles: true }));
  };
  const drag = (event, svg, ranges, show) => { // ranges: from two points to [axis, least, most]
    const first = place(svg, event);
    let found = [];
    const move = (now) => {
      found = ranges(first, place(svg, now));
      show(found);
      fade(found);
    };
    const end = (now) => {
      document.removeEventListener("pointermove", move);
      document.removeEventListener("pointerup", end);
      document.removeEventListener("pointercancel", end);
      if (now.type === "pointerup") choose(found);
      else fade([]);
    };
    event.preventDefault();
    move(event);
    document.addEventListener("pointermove", move);
    document.addEventListener("pointerup", end);
    document.addEventListener("pointercancel", end);
  };
  const sorted = (axis, one, other) => {
    const ends = [clamp(one), clamp(other)].sort((a, b) => a - b);
    return ends[1] - ends[0] < 0.01 ? [axis, 0, 1] : [axis, ...ends]; // a press alone takes the range away
  };
  const along = (event) => {
    const axis = event.target.parentNode;
    const svg = axis.ownerSVGElement;
    const [top, bottom, number] = [axis.dataset.top, axis.dataset.bottom, axis.dataset.axis].map(Number);
    const share = (point) => (bottom - point.y) / (bottom - top);
    const rect = axis.querySelector(".brush");
    const { x, width } = rect.attributes;
    drag(event, svg, (one, other) => [sorted(number, share(one), share(other))], ([[, least, most]]) => {
      const isAll = least === 0 && most === 1;
      box(rect, x.value, bottom - most * (bottom - top), width.value, isAll ? 0 : (most - least) * (bottom - top));
    });
  };
  const over = (event) => {
    const svg = event.target.ownerSVGElement;
    const [left, right, top, bottom] = ["left", "right", "top", "bottom"].map((name) => Number(svg.dataset[name]));
    const share = (at, from, to) => ((at - from) / (to - from) - 0.02) / 0.96; // as the dots are placed
    drag(event, svg, (one, other) => [
      sorted(Number(svg.dataset.x), share(one.x, left, right), share(other.x, left, right)),
      sorted(Number(svg.dataset.y), share(one.y, bottom, top), share(other.y, bottom, top)),
    ], ([[, west, east], [, south, north]]) => {
      const across = (at) => left + (0.02 + 0.96 * at) * (right - left);
      const up = (at) => bottom - (0.02 + 0.96 * at) * (bottom - top);
      box(svg.querySelector(".brush"), across(west), up(north), across(east) - across(west), up(south) - up(north));
    });
  };
  document.addEventListener("pointerdown", (event) => {
    if (event.button !== 0 || !event.target.classList) return;
    if (event.target.classList.contains("grip")) along(event);
    else if (event.target.classList.contains("ground")) over(event);
  });
})();
