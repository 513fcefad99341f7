"use strict";
// Answers in the text of a mechanism file: each changes the lines of its own key, and all others stay as they are.
const mechanismText = (function () {
  const GRAVITY = { SI: 9.81 }, USUAL = 9.81e-3; // m/s2, mm/ms2
  const isHeader = (line) => /^\s*\[/.test(line);
  const isMarked = (line) => /^# [A-Za-z_][\w-]* = /.test(line);
  const isOf = (key) => (line) => line.replace(/^# /, "").replace(/\s/g, "").startsWith(`${key}=`);
  const LITERALS = /"(?:[^"\\]|\\.)*"/g; // texts are moved as they are written, so nothing has to be unescaped

  // Return the first line of a table and the one after its last; the table "" is the top of the file.
  function linesOf(lines, table) {
    const start = table ? lines.findIndex((line) => line.replace(/#.*/, "").trim() === `[${table}]`) + 1 : 0;
    if (table && !start) return null;
    const end = lines.findIndex((line, i) => i >= start && isHeader(line));
    return [start, end < 0 ? lines.length : end];
  }

  function placeOf(lines, table, key) {
    const [start, end] = linesOf(lines, table) ?? [0, 0];
    const empty = lines.findIndex((line, i) => i >= start && (!line.trim() || /^# \[/.test(line)));
    const found = (from, to, fits) => lines.findIndex((line, i) => i >= from && i < to && fits(line) && isOf(key)(line));
    const active = found(start, end, (line) => !line.trimStart().startsWith("#"));
    return active >= 0 ? active : found(start, table && empty >= 0 ? Math.min(empty, end) : end, isMarked);
  }

  // Return the value of a key as it is written, "" if it has none.
  function read(text, table, key) {
    const lines = text.split("\n"), at = placeOf(lines, table, key);
    if (at < 0 || isMarked(lines[at])) return "";
    return lines[at].slice(lines[at].indexOf("=") + 1).replace(/\s+#[^"]*$/, "").trim();
  }

  // Return a text in which a key has a value, or no line if the value is "".
  function written(text, table, key, value) {
    const lines = text.split("\n"), at = placeOf(lines, table, key), span = linesOf(lines, table);
    if (!span) return text;
    const comment = at >= 0 ? /\s(#[^"]*)$/.exec(lines[at])?.[1] : "";
    const line = comment ? `${`${key} = ${value}`.padEnd(36)} ${comment}` : `${key} = ${value}`;
    if (at >= 0) lines.splice(at, 1, ...(value ? [line] : []));
    else if (value) lines.splice(span[0], 0, line);
    return lines.join("\n");
  }

  // Return a text without the question about a key, unless another proposed line below it waits for an answer.
  function settled(text, about) {
    const lines = text.split("\n"), at = lines.findIndex((line) => line.startsWith(`#? ${about}:`));
    if (at < 0) return text;
    const end = lines.findIndex((line, i) => i > at && (!line.trim() || isHeader(line) || line.startsWith("#?")));
    if (!lines.slice(at + 1, end < 0 ? lines.length : end).some(isMarked)) lines.splice(at, 1);
    return lines.join("\n");
  }

  const answered = (text, table, key, value, about) => settled(written(text, table, key, value), about);

  const number = (x) => (Number.isInteger(x) ? `${x + 0}.0` : String(x));

  // Return a number as it stands, and any other word as a text.
  const numberOrText = (word) => (word === "" || Number.isFinite(Number(word)) ? word : JSON.stringify(word));

  // Return a text with gravity along a direction, of length 1.
  function withGravity(text, down) {
    const size = GRAVITY[read(text, "", "units").slice(1, -1)] ?? USUAL;
    const vector = down.map((x) => number(Number((x * size).toPrecision(9)) || 0));
    return answered(text, "", "gravity", `[${vector.join(", ")}]`, "gravity");
  }

  // Return a text in which a body is fixed, or is not; the proposal for another one is withdrawn.
  function withFixed(text, body, isFixed) {
    let lines = written(text, `bodies.${body}`, "fixed", isFixed ? "true" : "").split("\n");
    const at = lines.findIndex((line) => line.startsWith("#? bodies:"));
    if (at >= 0 && isFixed) lines = lines.filter((line, i) => i !== at && !(i === at + 1 && line === "# fixed = true"));
    return lines.join("\n");
  }

  const bodies = (text) => [...text.matchAll(/^\s*\[bodies\.([\w-]+)\]/gm)].map((found) => found[1]);

  function partsOf(text, body) {
    const found = ["part", "parts"].flatMap((key) => read(text, `bodies.${body}`, key).match(LITERALS) ?? []);
    return found.length ? found : [`"${body}"`];
  }

  // Return the lines of the listed groups, each with the texts of its parts.
  function groups(text) {
    const lines = text.split("\n"), [start, end] = linesOf(lines, "groups") ?? [0, 0];
    return lines.slice(start, end).flatMap((line) => {
      const found = /^\s*("(?:[^"\\]|\\.)*"|[\w-]+)\s*=\s*(\[(?:[^\]"]|"(?:[^"\\]|\\.)*")*\])/.exec(line);
      return found ? [{ line, name: found[1], parts: found[2].match(LITERALS) ?? [] }] : [];
    });
  }

  // Return a text whose groups have bodies as one, or, of a single body, each of its parts by itself.
  function regrouped(text, ...joined) {
    const parts = [...new Set(joined.flatMap((body) => partsOf(text, body)))];
    const old = groups(text).filter((group) => group.parts.some((part) => parts.includes(part)));
    let lines = text.split("\n").filter((line) => !old.some((group) => group.line === line));
    if (joined.length < 2) return lines.join("\n");
    const all = [...new Set([...parts, ...old.flatMap((group) => group.parts)])];
    const bare = parts[0].slice(1, -1), name = old[0]?.name ?? (/^[A-Za-z_][\w-]*$/.test(bare) ? bare : parts[0]);
    const line = `${name} = [${all.join(", ")}]`;
    const span = linesOf(lines, "groups");
    if (span) lines.splice(span[0], 0, line);
    else {
      const first = Math.max(lines.findIndex(isHeader), 0);
      lines.splice(first, 0, "[groups]", line, "");
    }
    return lines.join("\n");
  }

  // Return the open questions of a text with their lines, from 1.
  const questions = (text) => text.split("\n").flatMap((line, i) => (
    line.trimStart().startsWith("#?") ? [{ line: i + 1, text: line.trim().slice(2).trim() }] : []));

  return { read, answered, written, numberOrText, withGravity, withFixed, bodies, partsOf, groups, regrouped, questions };
})();
