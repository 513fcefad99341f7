// Proposals in an editor from the schema of the file, while typing and at Ctrl+Space; without scripts, a text field.

import { proposalsAt } from "./schema_proposals.js";

const SHOWN = 8; // proposals at a time
const HINT = "Ctrl+Space proposes keys and values; the arrow keys choose, Enter inserts, Escape closes.";

function attach(text, schema) {
  const frame = text.closest(".editor");
  const list = frame.appendChild(document.createElement("ul"));
  Object.assign(list, { id: `${text.id}-proposals`, className: "proposals", hidden: true });
  list.setAttribute("role", "listbox");
  list.setAttribute("aria-label", "Proposals");
  const status = frame.appendChild(document.createElement("p"));
  status.className = "hint status";
  status.setAttribute("role", "status");
  status.textContent = HINT;
  for (const [name, value] of [["autocomplete", "list"], ["haspopup", "listbox"], ["controls", list.id]]) {
    text.setAttribute(`aria-${name}`, value);
  }
  let found = null, chosen = -1;

  const close = () => {
    found = null;
    list.hidden = true;
    text.removeAttribute("aria-activedescendant");
    status.textContent = HINT;
  };
  const draw = () => {
    const first = Math.min(Math.max(chosen - SHOWN + 1, 0), Math.max(found.options.length - SHOWN, 0));
    list.replaceChildren(...found.options.slice(first, first + SHOWN).map((option, i) => {
      const item = document.createElement("li");
      item.id = `${list.id}-${first + i}`;
      item.setAttribute("role", "option");
      item.setAttribute("aria-selected", String(first + i === chosen));
      item.setAttribute("aria-posinset", String(first + i + 1));
      item.setAttribute("aria-setsize", String(found.options.length));
      item.appendChild(document.createElement("code")).textContent = option.text;
      item.append(` ${option.about}`);
      item.addEventListener("mousedown", (event) => { event.preventDefault(); insert(option); });
      return item;
    }));
    if (chosen < 0) text.removeAttribute("aria-activedescendant");
    else text.setAttribute("aria-activedescendant", `${list.id}-${chosen}`);
    status.textContent = chosen < 0 ? `${found.options.length} proposals` : `${chosen + 1} of ${found.options.length}`;
  };
  const place = () => { // below the line, even when the text is scrolled
    if (!found) return;
    const lines = text.value.slice(0, found.from).split("\n");
    const style = getComputedStyle(text), high = parseFloat(style.lineHeight), wide = 0.6 * parseFloat(style.fontSize);
    const below = text.offsetTop + parseFloat(style.paddingTop) + lines.length * high - text.scrollTop;
    const right = text.offsetLeft + lines[lines.length - 1].length * wide - text.scrollLeft;
    list.style.top = `${below + 4}px`;
    list.style.left = `${Math.max(0, Math.min(right, frame.clientWidth - list.offsetWidth))}px`;
  };
  const open = (isAsked) => {
    const at = text.selectionStart;
    found = at === text.selectionEnd ? proposalsAt(schema, text.value, at) : null;
    if (!found || !found.options.length || !(isAsked || found.partial)) {
      close();
      if (isAsked) status.textContent = "No proposals here";
      return;
    }
    chosen = isAsked ? 0 : -1;
    list.hidden = false;
    draw();
    place();
  };
  const insert = (option) => {
    const after = text.value.slice(text.selectionStart);
    const rest = after.match(found.partial.startsWith('"') ? /^[\w-]*"?/ : /^[\w-]*/)[0];
    const inserted = /^\s*=/.test(after.slice(rest.length)) ? option.text : option.insert;
    const end = text.selectionStart + rest.length;
    text.focus();
    text.setSelectionRange(found.from, end);
    close();
    if (!document.execCommand("insertText", false, inserted)) { // the only way that the browser can undo
      text.setRangeText(inserted, text.selectionStart, text.selectionEnd, "end");
      text.dispatchEvent(new InputEvent("input", { bubbles: true }));
    }
    close();
  };
  text.addEventListener("keydown", (event) => {
    if ((event.ctrlKey && event.code === "Space") || (event.altKey && event.key === "ArrowDown")) {
      event.preventDefault();
      open(true);
      return;
    }
    if (!found || event.isComposing) return;
    const count = found.options.length;
    if (event.key === "ArrowDown" || event.key === "ArrowUp") {
      chosen = event.key === "ArrowDown" ? (chosen + 1) % count : (Math.max(chosen, 0) + count - 1) % count;
      draw();
    } else if (event.key === "Enter" && chosen >= 0) {
      insert(found.options[chosen]);
    } else if (event.key === "Escape") {
      close();
    } else {
      if (!/^(Shift|Control|Alt|Meta)$/.test(event.key) && event.key.length > 1 && event.key !== "Backspace") close();
      return;
    }
    event.preventDefault();
  });
  text.addEventListener("input", (event) => { if (/^(insertText|deleteContent)/.test(event.inputType || "")) open(false); });
  for (const kind of ["blur", "click"]) text.addEventListener(kind, close);
  text.addEventListener("scroll", place);
}

for (const text of document.querySelectorAll("textarea[data-schema]")) {
  fetch(text.dataset.schema).then((answer) => (answer.ok ? answer.json() : null)).then((schema) => { if (schema) attach(text, schema); });
}
