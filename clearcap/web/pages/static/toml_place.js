// The context of a position in a TOML text: its table, whether it is in a key, header or value, and the tables so far.

const TOKEN = /#[^\n]*|"""[\s\S]*?(?:"""|$)|'''[\s\S]*?(?:'''|$)|"(?:[^"\\\n]|\\.)*(?:"|$|(?=\n))|'[^'\n]*(?:'|$|(?=\n))|\n|[[\]{}=,.]|[^\s[\]{}=,.#"']+|[^\S\n]+/g;
const STRING = /^["']/;

const bare = (token) => (STRING.test(token) ? token.replace(/^("""|'''|"|')|("""|'''|"|')$/g, "") : token);

// Return a reader of tokens: `state` is its position, `tables` the tables so far: path -> key -> value as written.
function reader() {
  const tables = new Map();
  const counts = new Map();
  const named = (id) => tables.get(id) || tables.set(id, new Map()).get(id);
  const state = { kind: "key", table: [], id: "", parts: [], header: [], frames: [], held: named("") };
  const base = () => (state.frames.length ? state.frames[state.frames.length - 1].path : state.table);
  const begin = (kind) => { state.kind = kind; state.parts = []; };
  const close = () => {
    const frame = state.frames.pop();
    if (!frame) return;
    state.held = frame.outer;
    state.parts = frame.parts;
    state.kind = "end";
  };
  const bracket = () => {
    if (state.kind === "key" && !state.frames.length && !state.parts.length) {
      begin("header");
      state.header = [];
      state.isArray = false;
    } else if (state.kind === "header" && !state.header.length) {
      state.isArray = true;
    } else if (state.kind === "value") {
      state.frames.push({ kind: "[", path: [...base(), ...state.parts], parts: state.parts, outer: state.held });
      begin("value");
    }
  };
  const endHeader = () => {
    state.table = state.header;
    const path = state.header.join(".");
    if (state.isArray) counts.set(path, (counts.get(path) || 0) + 1);
    state.id = state.isArray ? `${path}#${counts.get(path)}` : path;
    state.held = named(state.id);
    begin("end");
  };
  const word = (token) => {
    if (state.kind === "header") state.header = [...state.header, bare(token)];
    else if (state.kind === "key") state.parts = [...state.parts, bare(token)];
    else if (state.kind === "value" && state.parts.length) {
      state.held.set(state.parts.join("."), token);
      state.kind = "end";
    }
  };
  const take = (token) => {
    if (/^(#|[^\S\n])/.test(token) || token === ".") return;
    if (token === "\n") { if (!state.frames.length) begin("key"); }
    else if (token === "=") { if (state.kind === "key") { state.held.set(state.parts.join("."), ""); state.kind = "value"; } }
    else if (token === "[") bracket();
    else if (token === "]") { if (state.kind === "header") endHeader(); else close(); }
    else if (token === "{") {
      if (state.kind !== "value") return;
      state.frames.push({ kind: "{", path: [...base(), ...state.parts], parts: state.parts, outer: state.held });
      state.held = new Map();
      begin("key");
    } else if (token === "}") close();
    else if (token === ",") {
      const frame = state.frames[state.frames.length - 1];
      if (frame) begin(frame.kind === "{" ? "key" : "value");
    } else word(token);
  };
  return { state, tables, take, path: () => [...base(), ...state.parts] };
}

// Return the context of a position in a text, {kind, path, partial, from, held, tables}; null in a comment.
export function placeIn(text, at) {
  const tokens = text.slice(0, at).match(TOKEN) || [];
  const last = tokens[tokens.length - 1] || "";
  if (last.startsWith("#")) return null;
  const isOpen = STRING.test(last) && (last.length === 1 || last[0] !== last[last.length - 1]);
  const isPartial = isOpen || (!STRING.test(last) && !/^[\s[\]{}=,.]/.test(last) && last !== "");
  const partial = isPartial ? last : "";
  const before = reader();
  tokens.slice(0, isPartial ? -1 : undefined).forEach(before.take);
  const whole = reader();
  (text.match(TOKEN) || []).forEach(whole.take);
  const { state } = before;
  const held = state.frames.length ? state.held : whole.tables.get(state.id) || state.held;
  const path = state.kind === "header" ? state.header : before.path();
  return { kind: state.kind, path, partial, from: at - partial.length, held, tables: whole.tables };
}
