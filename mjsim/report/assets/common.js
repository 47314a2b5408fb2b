// What the pages share: data, look, numbers as the page prints them.
"use strict";
document.documentElement.classList.add("js");
const mjsim = (() => {
  const read = (id) => JSON.parse(document.getElementById(id).textContent);
  const look = {
    ink: "#1b1b1b", soft: "#5c5c5c", grid: "#dedede", nominal: "#8a8a8a", band: "#e4ebf2", edge: "#8fb0d0",
    measured: "#222222", simulated: "#d9480f", former: "#0072b2",
    axes: { X: "#0072b2", Y: "#007a5a", Z: "#8a6d00", A: "#b3007d", C: "#5b3fb5" },
  };
  // fixed decimals, true minus sign, no negative zero, a dash for what is missing: as numbers.py does
  const fixed = (x, decimals) => x === null || x === undefined ? "–" : (x.toFixed(decimals).replace(/^-(0\.?0*)$/, "$1")).replace("-", "−");
  const niceStep = (smallest) => {
    const decade = 10 ** Math.floor(Math.log10(smallest));
    return [1, 2, 5, 10].map((f) => f * decade).find((s) => s >= smallest * (1 - 1e-9));
  };
  const element = (tag, properties = {}, ...children) => {
    const e = Object.assign(document.createElement(tag), properties);
    e.append(...children);
    return e;
  };
  const logTicks = (low, high) => {
    const out = [];
    for (let k = -4; k < 5; k++) for (const f of [1, 2, 5]) if (f * 10 ** k >= low && f * 10 ** k <= high) out.push(f * 10 ** k);
    return out;
  };
  // a switch with a piece of the line that it shows
  const chip = (text, checked, change, name, colour, dashed) => {
    const box = element("input", { type: "checkbox", checked, name });
    box.addEventListener("change", () => change(box.checked));
    const line = element("span", { className: "line" });
    line.style.borderTop = `2px ${dashed ? "dashed" : "solid"} ${colour}`;
    return element("label", {}, box, ...(colour ? [line] : []), text);
  };
  return { read, look, fixed, niceStep, element, logTicks, chip };
})();
