"use strict";
// Additions to forms: sliders beside numbers, and line numbers beside a text. Every form works without them.
(function () {
  for (const slider of document.querySelectorAll('input[type="range"][data-of]')) {
    const number = document.getElementById(slider.dataset.of);
    slider.hidden = false;
    slider.addEventListener("input", () => { number.value = String(Number(Number(slider.value).toPrecision(3))); });
    number.addEventListener("input", () => { slider.value = number.value; });
  }
  const number = (text) => {
    if (text.dataset.numbered) return;
    text.dataset.numbered = "yes";
    const wrong = new Set((text.dataset.faults || "").split(" ").filter(Boolean).map(Number));
    const frame = document.createElement("div");
    frame.className = "editor";
    const gutter = frame.appendChild(document.createElement("pre"));
    gutter.className = "gutter";
    gutter.setAttribute("aria-hidden", "true");
    text.before(frame);
    frame.appendChild(text);
    let count = 0;
    const draw = () => {
      const lines = text.value.split("\n").length;
      if (lines !== count) {
        gutter.replaceChildren();
        for (let n = 1; n <= lines; n += 1) {
          const line = gutter.appendChild(document.createElement("span"));
          line.textContent = `${n}\n`;
          if (wrong.has(n)) line.className = "wrong";
        }
        count = lines;
      }
      gutter.style.height = `${text.clientHeight}px`;
      gutter.scrollTop = text.scrollTop;
    };
    text.addEventListener("input", draw);
    text.addEventListener("scroll", draw);
    new ResizeObserver(draw).observe(text);
    draw();
    const first = Math.min(...wrong);
    if (Number.isFinite(first)) text.scrollTop = Math.max(0, (first - 5) * parseFloat(getComputedStyle(text).lineHeight));
  };
  const all = () => document.querySelectorAll("textarea[data-editor]").forEach(number);
  all();
  document.addEventListener("htmx:afterSettle", all);
  let open = []; // what is unfolded stays so when a part of the page is rendered again
  document.addEventListener("htmx:beforeSwap", () => { open = [...document.querySelectorAll("details[id][open]")].map((each) => each.id); });
  document.addEventListener("htmx:afterSwap", () => {
    for (const each of document.querySelectorAll("details[id]")) if (open.includes(each.id)) each.open = true;
  });
})();
