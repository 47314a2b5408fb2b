// Line plots in SVG: dragging zooms, a double click goes back, the pointer reads values.
"use strict";
mjsim.plot = (() => {
  const svg = (tag, attributes = {}, text) => {
    const e = document.createElementNS("http://www.w3.org/2000/svg", tag);
    for (const [name, value] of Object.entries(attributes)) if (value !== undefined) e.setAttribute(name, value);
    if (text !== undefined) e.textContent = text;
    return e;
  };
  const near = (x) => Math.round(x * 10) / 10;

  // Numbers at 1, 2 or 5 times a power of ten between low and high, about `count` of them.
  const ticks = (low, high, count) => {
    const step = mjsim.niceStep(Math.max(high - low, 1e-12) / count), out = [];
    for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) out.push(k * step);
    return out.map((v) => [v, mjsim.fixed(v, Math.max(0, -Math.floor(Math.log10(step) + 1e-9)))]);
  };

  // The path of a line in pixels; a gap where a value is missing.
  const path = (line, at) => {
    let d = "", pen = "M";
    line.x.forEach((x, i) => {
      if (x === null || line.y[i] === null) pen = "M";
      else {
        d += `${pen}${near(at.x(x))} ${near(at.y(line.y[i]))}`;
        pen = "L";
      }
    });
    return d;
  };

  // Where things stand: the view that was zoomed to, or the whole one, with square units if asked for.
  const placed = (host, spec) => {
    const width = Math.max(host.clientWidth, 80), height = Math.max(host.clientHeight, 80), [top, right, bottom, left] = spec.margins;
    const w = width - left - right, h = height - top - bottom;
    let { x: [x0, x1], y: [y0, y1] } = host.zoomed || spec;
    if (spec.square) {
      const scale = Math.max((x1 - x0) / w, (y1 - y0) / h), cx = (x0 + x1) / 2, cy = (y0 + y1) / 2;
      [x0, x1, y0, y1] = [cx - scale * w / 2, cx + scale * w / 2, cy - scale * h / 2, cy + scale * h / 2];
    }
    return {
      width, height, left, top, w, h, view: { x: [x0, x1], y: [y0, y1] },
      x: (v) => left + w * (v - x0) / (x1 - x0), y: (v) => top + h * (y1 - v) / (y1 - y0),
      backX: (px) => x0 + (x1 - x0) * (px - left) / w, backY: (px) => y1 - (y1 - y0) * (px - top) / h,
    };
  };

  const axes = (root, spec, at) => {
    const { left, top, w, h, view } = at, text = { fill: mjsim.look.ink };
    if (spec.xTicks) {
      for (const [v, label] of spec.xTicks(view.x[0], view.x[1], w)) {
        root.append(svg("line", { x1: at.x(v), x2: at.x(v), y1: top + h, y2: top + h + 3, stroke: mjsim.look.nominal }));
        label.split("\n").forEach((row, i) => root.append(svg("text", { ...text, x: at.x(v), y: top + h + 15 + 13 * i, "text-anchor": "middle" }, row)));
      }
      root.append(svg("line", { x1: left, x2: left + w, y1: top + h, y2: top + h, stroke: mjsim.look.nominal }));
    }
    if (spec.yTicks) {
      for (const [v, label] of spec.yTicks(view.y[0], view.y[1], h)) {
        root.append(svg("line", { x1: left, x2: left + w, y1: at.y(v), y2: at.y(v), stroke: mjsim.look.grid }));
        root.append(svg("text", { ...text, x: left - 6, y: at.y(v) + 4, "text-anchor": "end" }, label));
      }
    }
    if (spec.xTitle) root.append(svg("text", { ...text, x: left + w / 2, y: top + h + 31, "text-anchor": "middle" }, spec.xTitle));
    if (spec.yTitle) root.append(svg("text", { ...text, x: 0, y: 0, transform: `translate(11 ${top + h / 2}) rotate(-90)`, "text-anchor": "middle" }, spec.yTitle));
  };

  // Draw `spec` into `host`, an element with a size of its own:
  //   margins [top, right, bottom, left] px; x, y [low, high]; square; xTicks, yTicks (low, high, px) → [[value, label]]; xTitle, yTitle
  //   lines [{ name, x, y, colour, width, dash, dots, text: (i) → rows }]; under, over (at) → svg elements; byX: read by the x alone
  const draw = (host, spec) => {
    host.spec = spec;
    const at = placed(host, spec), id = host.plotId || (host.plotId = `plot-${draw.count = (draw.count || 0) + 1}`);
    const root = svg("svg", { width: at.width, height: at.height, "font-size": 11.5 });
    const clip = svg("clipPath", { id });
    clip.append(svg("rect", { x: at.left, y: at.top, width: at.w, height: at.h }));
    const inside = svg("g", { "clip-path": `url(#${id})` });
    axes(root, spec, at);
    if (spec.under) inside.append(...spec.under(at));
    for (const line of spec.lines) {
      inside.append(svg("path", { d: path(line, at), "data-name": line.name, fill: "none", stroke: line.colour, "stroke-width": line.width, "stroke-dasharray": line.dash, "stroke-linejoin": "round" }));
      if (line.dots) line.x.forEach((x, i) => line.y[i] === null || inside.append(svg("circle", { cx: at.x(x), cy: at.y(line.y[i]), r: 4, fill: line.colour })));
    }
    root.append(clip, inside, ...(spec.over ? spec.over(at) : []));
    host.replaceChildren(root);
    if (!host.heard) listen(host);
    host.heard = true;
  };

  // The sample under the pointer: of all lines the nearest, or the nearest in x.
  const nearest = (host, at, px, py) => {
    let best = null, least = host.spec.byX ? 12 : 24;
    for (const line of host.spec.lines) {
      if (!line.text) continue;
      line.x.forEach((x, i) => {
        if (x === null || line.y[i] === null) return;
        const sx = at.x(x), sy = at.y(line.y[i]), away = host.spec.byX ? Math.abs(sx - px) : Math.hypot(sx - px, sy - py);
        if (away < least) { least = away; best = { line, i, sx, sy }; }
      });
    }
    return best;
  };
  const read = (host, px, py) => {
    host.querySelectorAll(".reading").forEach((e) => e.remove());
    const at = placed(host, host.spec), found = nearest(host, at, px, py);
    if (!found) return;
    const tip = mjsim.element("div", { className: "reading tip" }, ...found.line.text(found.i).map((row) => mjsim.element("div", { textContent: row })));
    host.firstChild.append(svg("circle", { class: "reading", cx: found.sx, cy: found.sy, r: 4, fill: "none", stroke: found.line.colour, "stroke-width": 2 }));
    host.append(tip);
    tip.style.left = `${Math.min(Math.max(0, found.sx + 12), Math.max(0, at.width - tip.offsetWidth))}px`;
    tip.style.top = `${found.sy > at.height / 2 ? found.sy - tip.offsetHeight - 10 : found.sy + 12}px`;
  };

  const listen = (host) => {
    let from = null, box = null;
    const place = (e) => { const r = host.getBoundingClientRect(); return [e.clientX - r.left, e.clientY - r.top]; };
    const clear = () => host.querySelectorAll(".reading").forEach((e) => e.remove());
    const stop = () => { from = null; if (box) box.remove(); box = null; };
    host.addEventListener("pointerdown", (e) => {
      if (e.button || host.spec.fixed || e.pointerType === "touch") return;
      from = place(e);
      host.setPointerCapture(e.pointerId);
      e.preventDefault();
    });
    host.addEventListener("pointermove", (e) => {
      const [x, y] = place(e);
      if (!from) { read(host, x, y); return; }
      clear();
      if (!box) host.firstChild.append(box = svg("rect", { fill: mjsim.look.former, "fill-opacity": 0.12, stroke: mjsim.look.former }));
      for (const [k, v] of [["x", Math.min(from[0], x)], ["y", Math.min(from[1], y)], ["width", Math.abs(x - from[0])], ["height", Math.abs(y - from[1])]]) box.setAttribute(k, v);
    });
    host.addEventListener("pointerup", (e) => {
      if (!from) return;
      const [x, y] = place(e), [ax, ay] = from, at = placed(host, host.spec);
      stop();
      if (Math.abs(x - ax) < 6 || Math.abs(y - ay) < 6) return;
      host.zoomed = { x: [at.backX(Math.min(x, ax)), at.backX(Math.max(x, ax))], y: [at.backY(Math.max(y, ay)), at.backY(Math.min(y, ay))] };
      draw(host, host.spec);
    });
    host.addEventListener("pointercancel", stop);
    host.addEventListener("pointerleave", () => { if (!from) clear(); });
    host.addEventListener("dblclick", () => reset(host));
  };
  const reset = (host) => { host.zoomed = null; if (host.spec) draw(host, host.spec); };
  addEventListener("resize", () => { for (const host of document.querySelectorAll(".plot")) if (host.spec && host.clientWidth) draw(host, host.spec); });
  return { draw, reset, ticks, svg };
})();
