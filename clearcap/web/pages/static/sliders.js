"use strict";
// Keep each slider and its number in step; only the number is sent.
(function () {
  for (const slider of document.querySelectorAll("input[type=range][data-for]")) {
    const number = document.getElementById(slider.dataset.for);
    slider.hidden = false;
    slider.value = number.value;
    slider.addEventListener("input", () => { number.value = String(Number(Number(slider.value).toPrecision(6))); });
    number.addEventListener("input", () => { slider.value = number.value; });
  }
})();
