"use strict";
// Answers to what the mechanism file asks, by buttons and by clicks on parts and faces; the file is saved, or handed to
// the page that this one is shown in. It works without the 3D scene, too.
(function () {
  const element = (id) => document.getElementById(id);
  const data = JSON.parse(element("data").textContent);
  const isInFrame = window.parent !== window;
  let text = data.text;

  const select = (id, words) => element(id).replaceChildren(...words.map(([value, label]) => new Option(label, value)));
  const chosen = () => element("part").value;
  const isListed = (body) => mechanismText.groups(text).some(
    (group) => group.parts.some((part) => mechanismText.partsOf(text, body).includes(part)));

  function set(changed, said) {
    text = changed;
    element("said").textContent = said;
    show();
    if (isInFrame) window.parent.postMessage({ text }, "*"); // its address is not known in a sandbox
  }

  function show() {
    const bodies = mechanismText.bodies(text), at = chosen();
    select("part", bodies.map((body) => [body, body]));
    if (bodies.includes(at)) element("part").value = at;
    const body = chosen(), other = element("other").value;
    select("other", bodies.filter((each) => each !== body).map((each) => [each, each]));
    if (other !== body && bodies.includes(other)) element("other").value = other;
    const isFixed = mechanismText.read(text, `bodies.${body}`, "fixed") === "true";
    element("fix").textContent = isFixed ? "Let it move" : "Fix it";
    element("apart").hidden = !isListed(body);
    element("gravity").textContent = mechanismText.read(text, "", "gravity") || "not said";
    for (const field of document.querySelectorAll("#answers input[data-key]")) {
      const [table, key] = keyOf(field);
      field.value = mechanismText.read(text, table, key).replace(/^"(.*)"$/, "$1");
    }
    const asked = mechanismText.questions(text), rows = element("open");
    element("questions").textContent = `Questions (${asked.length})`;
    for (const row of [...rows.children]) {
      const found = asked.find((each) => each.text === row.dataset.text);
      if (found) row.querySelector("button, b").textContent = `line ${found.line}`;
      row.hidden = !found;
    }
    element("save").href = `data:text/plain;charset=utf-8,${encodeURIComponent(text)}`;
  }

  const keyOf = (field) => [field.dataset.table.replace("*", chosen()), field.dataset.key];

  function gravity(down, said) {
    set(mechanismText.withGravity(text, down), said);
  }

  element("down").addEventListener("change", ({ target }) => {
    if (target.value) gravity(target.value.split(" ").map(Number), `Gravity acts ${target.selectedOptions[0].text}.`);
    target.value = "";
  });
  element("stand").addEventListener("click", () => stand(element("stand").getAttribute("aria-pressed") !== "true"));

  function stand(isAsked) {
    element("stand").setAttribute("aria-pressed", String(isAsked));
    element("said").textContent = isAsked ? "Click the flat face on which the mechanism stands." : "";
  }

  document.addEventListener("face", ({ detail }) => {
    if (!detail.normal) {
      element("said").textContent = `That face of ${detail.part} is not flat: click a flat one.`;
      return;
    }
    stand(false);
    gravity(detail.normal, `It stands on a face of ${detail.part}.`);
  });
  document.addEventListener("part", ({ detail }) => {
    if (![...element("part").options].some((option) => option.value === detail)) return;
    element("part").value = detail;
    show();
  });
  element("part").addEventListener("change", show);
  element("fix").addEventListener("click", () => {
    const body = chosen(), isFixed = mechanismText.read(text, `bodies.${body}`, "fixed") === "true";
    set(mechanismText.withFixed(text, body, !isFixed), isFixed ? `${body} moves.` : `${body} is fixed.`);
  });
  const follow = isInFrame ? "press Bring bodies to the groups below" : `run ${data.update}`;
  element("join").addEventListener("click", () => {
    const [body, other] = [chosen(), element("other").value];
    if (other) set(mechanismText.regrouped(text, body, other), `${body} and ${other} are one group; ${follow}.`);
  });
  element("apart").addEventListener("click", () => {
    const body = chosen();
    set(mechanismText.regrouped(text, body), `The parts of ${body} are no group any more; ${follow}.`);
  });
  for (const field of document.querySelectorAll("#answers input[data-key]")) {
    field.addEventListener("change", () => {
      const [table, key] = keyOf(field), word = field.value.trim();
      if (key !== "density" && !(word !== "" && Number(word) >= 0)) {
        show();
        element("said").textContent = `${key}: ${word || "nothing"} is no number of 0 or more.`;
        return;
      }
      const value = mechanismText.numberOrText(word);
      set(mechanismText.answered(text, table, key, value, field.dataset.about), `${key} is ${word || "not said"}.`);
    });
  }
  if (isInFrame) {
    window.addEventListener("message", (event) => {
      if (event.source !== window.parent || typeof event.data?.text !== "string") return;
      text = event.data.text;
      show();
    });
    window.parent.postMessage({ isReady: true }, "*");
  }
  element("save").hidden = isInFrame;
  element("answers").hidden = false;
  show();
})();
