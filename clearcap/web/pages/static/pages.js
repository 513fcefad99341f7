"use strict";
// Follow a campaign: each event holds the whole state, so a page that missed some events shows the last one.
(function () {
  const live = document.getElementById("live");
  if (!live || !live.dataset.events || !window.EventSource) return;
  const field = (name) => live.querySelector(`[data-field="${name}"]`);
  const grouped = (n) => (n === null ? "" : n.toLocaleString("en").replace(/,/g, "\u202f"));
  const brief = (x) => (x === null || x === undefined ? "" : x === 0 ? "0" : x.toPrecision(4).replace("e+", "e"));
  const index = (x) => { // as in the report: with enough decimals that rounding does not reach or cross a target
    if (x === null || x === undefined) return "";
    if (Math.abs(x) > 100) return x > 0 ? "> 100.00" : "< -100.00";
    const keepsItsSide = (text) => [1, 1.33].every((target) => Math.sign(text - target) === Math.sign(x - target));
    const texts = [3, 4, 5, 6, 7, 8, 9, 10, 11, 12].map((decimals) => x.toFixed(decimals));
    return texts.find(keepsItsSide) || String(x);
  };
  const duration = (s) => {
    if (s === null) return "";
    if (s < 100) return `${Math.round(s)} s`;
    return s < 6000 ? `${Math.round(s / 60)} min` : `${(s / 3600).toFixed(1)} h`;
  };
  const cell = (row, kind, text, numeric) => {
    const made = row.appendChild(document.createElement(kind));
    made.textContent = text;
    if (numeric) made.className = "number";
    return made;
  };
  const show = (p) => {
    field("state").textContent = p.state;
    field("state").className = `state ${p.state}`;
    field("message").textContent = p.message;
    field("waits_for").textContent = p.waits_for;
    const cancel = document.querySelector('[data-field="cancel"]');
    if (cancel && ["completed", "cancelled", "failed"].includes(p.state)) cancel.remove();
    if (p.done === null) return;
    field("bar").max = p.samples || 1;
    field("bar").value = p.done;
    for (const name of ["done", "samples", "failed"]) field(name).textContent = grouped(p[name]);
    field("rate").textContent = p.rate ? `${brief(p.rate)} runs/s` : "";
    field("eta").textContent = duration(p.eta_s);
    field("workers").textContent = p.workers;
    const statuses = field("statuses");
    statuses.replaceChildren();
    for (const [status, count] of Object.entries(p.statuses)) {
      statuses.appendChild(document.createElement("li")).textContent = `${grouped(count)} ${status}`;
    }
    const rows = field("responses");
    rows.replaceChildren();
    for (const [name, r] of Object.entries(p.responses)) {
      const row = rows.appendChild(document.createElement("tr"));
      cell(row, "th", name).scope = "row";
      cell(row, "td", grouped(r.n), true);
      cell(row, "td", brief(r.mean), true);
      cell(row, "td", brief(r.std), true);
      cell(row, "td", index(r.cpk), true);
      cell(row, "td", r.cpk_interval ? `${index(r.cpk_interval[0])} to ${index(r.cpk_interval[1])}` : "").className = "interval";
    }
  };
  const source = new EventSource(live.dataset.events);
  source.addEventListener("progress", (event) => show(JSON.parse(event.data)));
  source.addEventListener("end", () => {
    source.close();
    window.setTimeout(() => window.location.reload(), 2000); // to show the report, and the actions that are now possible
  });
})();
