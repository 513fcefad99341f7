"use strict";
// Animate the drawing of a run. Without scripts, and for users who prefer less motion, it shows the end of the run.
(function () {
  const set = (figure) => {
    const frames = JSON.parse(figure.dataset.motion);
    const last = frames.time.length - 1;
    const one = (selector) => figure.querySelector(selector);
    const line = (numbers, place) => {
      const points = [];
      for (let i = 0; i < numbers.length; i += 3) {
        const [x, y, z] = numbers.slice(i, i + 3);
        const right = place[0] * x + place[1] * y + place[2] * z + place[6];
        const down = place[3] * x + place[4] * y + place[5] * z + place[7];
        points.push(`${right.toFixed(1)} ${down.toFixed(1)}`);
      }
      return `M${points[0]}L${points.slice(1).join("L") || points[0]}`;
    };
    const bodies = [...figure.querySelectorAll("[data-body]")].map((group, i) => {
      const body = frames.bodies[i], paths = [...group.querySelectorAll("path")];
      return (frame) => {
        const place = body.places[frame];
        for (const path of paths) {
          const part = path.dataset.part, end = part === "outline" ? "Z" : "";
          path.setAttribute("d", body.parts[part].map((each) => line(each, place) + end).join(""));
        }
      };
    });
    const labels = [...figure.querySelectorAll("[data-label]")].map((label) => (frame) => {
      const body = frames.bodies[label.dataset.label];
      const [x, y] = line(body.middle, body.places[frame]).slice(1).split("L")[0].split(" ");
      label.setAttribute("x", x);
      label.setAttribute("y", y);
    });
    const rings = [...figure.querySelectorAll("[data-ring]")].map((group) => {
      const points = frames.plays[group.dataset.play][group.dataset.ring], [trail, dot] = group.querySelectorAll("path");
      return (frame) => {
        trail.setAttribute("d", `M${points.slice(Math.max(frame - frames.trail, 0), frame + 1).map((p) => p.join(" ")).join("L")}`);
        dot.setAttribute("d", `M${points[frame].join(" ")}h0`);
      };
    });
    const button = one("button"), slider = one("input"), clock = one("[data-clock]"), speed = one("select"), unit = slider.dataset.unit;
    let now = last, held = 0, timer = 0;
    const show = (frame) => {
      now = frame;
      for (const draw of [...bodies, ...labels, ...rings]) draw(frame);
      one("[data-springs]").setAttribute("d", frames.springs[frame]);
      one("[data-arrows]").setAttribute("d", frames.arrows[frame]);
      slider.value = String(frame);
      clock.textContent = `t = ${frames.time[frame].toPrecision(4)} ${unit}`;
      slider.setAttribute("aria-valuetext", clock.textContent);
    };
    const advance = () => {
      if (now < last) { held = 0; show(now + 1); } else if (held < frames.hold) held += 1; else show(0);
    };
    const play = (isPlaying) => {
      window.clearInterval(timer);
      timer = isPlaying ? window.setInterval(advance, 1000 / (frames.second * Number(speed.value))) : 0;
      button.textContent = isPlaying ? "Pause" : "Play";
    };
    button.addEventListener("click", () => { if (!timer && now === last) show(0); play(!timer); });
    speed.addEventListener("change", () => { if (timer) play(true); });
    slider.addEventListener("input", () => { play(false); show(Number(slider.value)); });
    slider.max = String(last);
    show(last);
    one(".player").hidden = last === 0;
    const isCalm = window.matchMedia("(prefers-reduced-motion: reduce)");
    isCalm.addEventListener("change", () => { if (isCalm.matches) play(false); });
    if (last > 0 && !isCalm.matches) { show(0); play(true); }
  };
  document.querySelectorAll("figure[data-motion]").forEach(set);
})();
