// The keys and values that a JSON Schema allows at a position in a TOML text.

import { placeIn } from "./toml_place.js";

// Return the alternatives of a schema with references resolved, after the properties that they have in common.
function alternatives(root, schema) {
  if (schema.$ref) return alternatives(root, root.$defs[schema.$ref.split("/").pop()]);
  const several = schema.anyOf || schema.oneOf || schema.allOf;
  if (!several) return [schema];
  const { anyOf, oneOf, allOf, ...common } = schema;
  return [...(common.properties ? [common] : []), ...several.flatMap((each) => alternatives(root, each))];
}

// Return the table schemas that a schema allows, without those that contradict the present content (unless all do).
function tablesOf(root, schema, held) {
  const all = alternatives(root, schema).flatMap((each) => (each.items ? alternatives(root, each.items) : [each]));
  const known = [...(held || [])].filter(([, value]) => /^"[^"]*"$/.test(value)).map(([key, value]) => [key, value.slice(1, -1)]);
  const fits = (table) => known.every(([key, value]) => {
    const wanted = allowed(root, (table.properties || {})[key]);
    return !wanted.length || wanted.includes(value);
  });
  const fitting = all.filter(fits);
  return fitting.length ? fitting : all;
}

// Return the texts that a schema allows for a key; empty if it does not restrict them.
function allowed(root, schema) {
  const each = schema ? alternatives(root, schema) : [];
  return each.every((one) => one.enum || one.const !== undefined) ? each.flatMap((one) => one.enum || [one.const]) : [];
}

// Return the schemas of the value at a path.
function schemasAt(root, path, tables) {
  let found = [root];
  path.forEach((key, depth) => {
    const held = tables.get(path.slice(0, depth).join("."));
    found = found.flatMap((schema) => tablesOf(root, schema, held)).flatMap((table) => {
      const named = (table.properties || {})[key];
      const any = Object.values(table.patternProperties || {})[0] || table.additionalProperties;
      return named ? [named] : any instanceof Object ? [any] : [];
    });
  });
  return found;
}

// Return whether a schema describes a table or a list of tables.
function isTableOrTables(root, schema) {
  const inner = schema.items ? alternatives(root, schema.items) : [schema];
  return inner.some((each) => each.type === "object");
}

// Return the keys of tables as {text, insert, about}, required keys first.
function keysOf(root, tables, place) {
  const found = new Map();
  for (const table of tables) {
    for (const [key, schema] of Object.entries(table.properties || {})) {
      const isTable = alternatives(root, schema).some((each) => isTableOrTables(root, each));
      if (place.kind === "header" ? !isTable : place.held.has(key)) continue;
      const insert = place.kind === "header" ? key : isTable && !place.path.length ? `${key}.` : `${key} = `;
      const isNeeded = (table.required || []).includes(key);
      found.set(key, found.get(key) || { text: key, insert, about: schema.description || "", isNeeded });
    }
  }
  return [...found.values()].sort((a, b) => Number(b.isNeeded) - Number(a.isNeeded));
}

// Return the values that schemas list and, for the key `body`, the names of the bodies in the text.
function valuesOf(root, schemas, place) {
  const key = place.path[place.path.length - 1] || "";
  const plural = Object.keys(root.properties).find((each) => [`${key}s`, key.replace(/y$/, "ies")].includes(each) && each !== key);
  const values = schemas.flatMap((schema) => [
    ...[...alternatives(root, schema), schema].flatMap((each) => [
      ...(each.enum || []),
      ...(each.const === undefined ? [] : [each.const]),
      ...(each.type === "boolean" ? [true, false] : []),
      ...(each.examples || []),
    ]),
    ...(["string", "number", "boolean"].includes(typeof schema.default) && schema.default !== "" ? [schema.default] : []),
  ]);
  const isText = schemas.some((schema) => alternatives(root, schema).some((each) => each.type === "string"));
  const names = [...place.tables.keys()].map((id) => id.split(".")).filter((parts) => parts[0] === plural && parts.length === 2);
  if (isText) values.push(...names.map((parts) => parts[1]));
  const about = (schemas.find((schema) => schema.description) || {}).description || "";
  return [...new Set(values.map((value) => JSON.stringify(value)))].map((text) => ({ text, insert: text, about }));
}

// Return the proposals at a position in a text, {from, options: [{text, insert, about}]}; null if there can be none.
export function proposalsAt(root, text, at) {
  const place = placeIn(text, at);
  if (!place || place.kind === "end") return null;
  const schemas = schemasAt(root, place.path, place.tables);
  const tables = schemas.flatMap((schema) => tablesOf(root, schema, place.kind === "key" ? place.held : null));
  const options = place.kind === "value" ? valuesOf(root, schemas, place) : keysOf(root, tables, place);
  const begin = place.partial.toLowerCase();
  const fitting = options.filter((each) => each.text.toLowerCase().startsWith(begin) && each.text !== place.partial);
  return { from: place.from, partial: place.partial, options: fitting };
}
