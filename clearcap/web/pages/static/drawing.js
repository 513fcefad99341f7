"use strict";
// The text of a draft and the page of what was found hand each other what is answered; each works without the other.
(function () {
  const frame = document.querySelector("iframe[data-answers]"), text = document.getElementById("text");
  const tell = () => frame.contentWindow.postMessage({ text: text.value }, "*"); // a sandbox has no address
  window.addEventListener("message", ({ source, data }) => {
    if (source !== frame.contentWindow) return;
    if (typeof data?.text !== "string") { tell(); return; }
    text.value = data.text;
    text.dispatchEvent(new Event("input", { bubbles: true }));
  });
  text.addEventListener("input", tell);
  tell();
})();
