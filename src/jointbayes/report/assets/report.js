(() => {
  "use strict";

  const INK = "#1b2430", GRID = "rgba(27, 36, 48, 0.12)", FONT = "12px system-ui, sans-serif";
  const SUPERSCRIPT = { "-": "⁻", 0: "⁰", 1: "¹", 2: "²", 3: "³", 4: "⁴", 5: "⁵", 6: "⁶", 7: "⁷", 8: "⁸", 9: "⁹" };
  const superscript = (n) => String(n).replace(/./g, (c) => SUPERSCRIPT[c]);
  const minus = (text) => text.replace(/^-/, "−");

  const trim = (text) => text.includes(".") ? text.replace(/\.?0+$/, "") : text;
  const scientific = (value, digits, bare = false) => {
    const [mantissa, exponent] = value.toExponential(digits - 1).split("e");
    const short = trim(mantissa);
    const power = "10" + superscript(Number(exponent));
    return minus(bare && short === "1" ? power : `${short} × ${power}`);
  };
  const number = (value, digits) => {
    const size = Math.abs(value);
    if (size !== 0 && (size < 1e-3 || size >= 1e5)) return scientific(value, digits);
    return minus(trim(value.toPrecision(digits).includes("e") ? String(value) : value.toPrecision(digits)));
  };

  const decade = (value) => Math.floor(Math.log10(value) + 1e-9);
  const lead = (value) => Math.round(value / 10 ** decade(value));
  const decades = (min, max) => Math.log10(max / min);

  // uPlot labels only some decades of a logarithmic axis, and none when less than a decade is in view.
  const logSplits = (u, axis, min, max) => {
    const splits = [];
    if (decades(min, max) < 0.8) {
      const rough = (max - min) / 5, power = 10 ** Math.floor(Math.log10(rough));
      const step = power * [1, 2, 2.5, 5, 10].find((factor) => factor * power >= rough);
      for (let i = Math.ceil(min / step); i * step <= max; i++) splits.push(Number((i * step).toPrecision(12)));
      return splits;
    }
    const units = decades(min, max) > 9 ? [1] : [1, 2, 3, 4, 5, 6, 7, 8, 9];
    for (let exponent = decade(min); exponent <= decade(max) + 1; exponent++) {
      for (const unit of units) {
        const value = Number(`${unit}e${exponent}`);
        if (value >= min * (1 - 1e-9) && value <= max * (1 + 1e-9)) splits.push(value);
      }
    }
    return splits;
  };
  const labelled = (u, splits, key) => {
    const { min, max } = u.scales[key];
    const span = decades(min, max);
    if (span < 0.8) return splits.map(() => true);
    const every = Math.ceil(span / 9);
    const units = span > 2.2 ? [1] : span > 1.2 ? [1, 2, 5] : [1, 2, 3, 5];
    return splits.map((value) => units.includes(lead(value)) && (span <= 2.2 || decade(value) % every === 0));
  };

  const axis = (key, label, log, sideways) => {
    const options = {
      scale: key, label, font: FONT, labelFont: `600 ${FONT}`, stroke: INK, size: 28, labelSize: 20, labelGap: 0, gap: 5,
      grid: { stroke: GRID, width: 1 }, ticks: { stroke: INK, width: 1, size: 5 }, border: { show: true, stroke: INK, width: 1 },
      values: (u, splits) => splits.map((value) => value === null ? "" : number(value, 6)),
    };
    if (log) {
      options.splits = logSplits;
      options.filter = (u, splits) => splits;
      options.grid.filter = (u, splits) => labelled(u, splits, key).map((shown, i) => shown ? splits[i] : null);
      options.values = (u, splits) => {
        const shown = labelled(u, splits, key), wide = splits.length > 0 && decades(splits[0], splits[splits.length - 1]) > 4;
        return splits.map((value, i) => !shown[i] ? "" : wide ? scientific(value, 6, true) : number(value, 6));
      };
    }
    if (sideways) {
      options.size = (u, values) => {
        const context = u.ctx;
        context.save();
        context.font = FONT;
        const widest = Math.max(0, ...(values ?? []).map((text) => context.measureText(text ?? "").width));
        context.restore();
        return Math.ceil(widest) + 16;
      };
    }
    return options;
  };

  const padded = (log) => (u, min, max) => {
    if (min === null || max === null) return log ? [1, 10] : [0, 1];
    if (log) return min === max ? [min / 2, max * 2] : [min / (max / min) ** 0.04, max * (max / min) ** 0.04];
    const margin = min === max ? Math.abs(min) * 0.1 || 1 : (max - min) * 0.05;
    return [min - margin, max + margin];
  };
  // Points would sit on the frame in the full view, so the axis goes a little beyond them; curves may fill it.
  const fitted = (loose, full) => (u, min, max) => {
    const whole = min === full.min && max === full.max;
    return min === null || max === null || min === max || (loose && whole) ? padded(false)(u, min, max) : [min, max];
  };

  const translucent = (colour, alpha) => colour + Math.round(alpha * 255).toString(16).padStart(2, "0");

  const element = (name, properties = {}, ...children) => {
    const made = Object.assign(document.createElement(name), properties);
    made.append(...children);
    return made;
  };
  const switches = (label, names, choose) => {
    const group = element("div", { className: "switches" });
    group.setAttribute("role", "group");
    group.setAttribute("aria-label", label);
    const buttons = names.map((name) => element("button", { type: "button", textContent: name }));
    const press = (name) => {
      buttons.forEach((button) => button.setAttribute("aria-pressed", String(button.textContent === name)));
      choose(name);
    };
    buttons.forEach((button) => button.addEventListener("click", () => press(button.textContent)));
    group.append(...buttons);
    return { group, press };
  };

  // One list of x with a hole wherever a series has no value there: uPlot draws through undefined.
  const prepare = (plot) => {
    const rank = { band: 0, line: 1, points: 2 };
    const ordered = plot.series.slice().sort((a, b) => rank[a.kind] - rank[b.kind]);
    const tables = [], series = [{}], bands = [], groups = new Map();
    for (const one of ordered) {
      const columns = [one.x], members = [];
      const add = (values, options) => { columns.push(values); members.push(series.length); series.push({ spanGaps: false, show: !one.hidden, ...options }); };
      if (one.kind === "band") {
        const edge = { stroke: translucent(one.colour, 0.35), width: 1, points: { show: false } };
        bands.push({ series: [series.length, series.length + 1], fill: translucent(one.colour, 0.18) });
        add(one.y_high, edge);
        add(one.y_low, edge);
      }
      if (one.kind === "points") {
        add(one.y, { paths: () => null, points: { show: true, size: one.x.length > 60 ? 4 : 6, stroke: one.colour, fill: one.colour } });
      } else if (one.y.length) {
        add(one.y, { stroke: one.colour, width: one.width ?? 1.75, dash: one.dashed ? [7, 4] : undefined, points: { show: one.x.length === 1 } });
      }
      tables.push(columns);
      groups.set(one.name, members);
    }
    return { data: uPlot.join(tables), series, bands, groups };
  };

  const swatch = (one) => {
    const space = document.createElementNS("http://www.w3.org/2000/svg", "svg");
    space.setAttribute("viewBox", "0 0 28 12");
    space.setAttribute("aria-hidden", "true");
    const draw = (name, attributes) => {
      const shape = document.createElementNS(space.namespaceURI, name);
      for (const [key, value] of Object.entries(attributes)) shape.setAttribute(key, value);
      space.append(shape);
    };
    if (one.kind === "band") draw("rect", { x: 1, y: 1, width: 26, height: 10, fill: one.colour, "fill-opacity": 0.2 });
    if (one.kind === "points") draw("circle", { cx: 14, cy: 6, r: 3.5, fill: one.colour });
    else if (one.kind !== "band" || one.y.length) draw("line", { x1: 1, x2: 27, y1: 6, y2: 6, stroke: one.colour, "stroke-width": 2, ...(one.dashed ? { "stroke-dasharray": "6 4" } : {}) });
    return space;
  };

  // Entries that switch their curves on and off; `one.hidden` is what they switch.
  const legend = (series, changed) => {
    const list = element("ul", { className: "legend" });
    for (const one of series) {
      const button = element("button", { type: "button" }, swatch(one), one.name);
      button.setAttribute("aria-pressed", String(!one.hidden));
      button.addEventListener("click", () => {
        one.hidden = !one.hidden;
        button.setAttribute("aria-pressed", String(!one.hidden));
        changed(one);
      });
      list.append(element("li", {}, button));
    }
    return list;
  };

  const nearest = (values, index) => {
    for (let step = 0; step < values.length; step++) {
      for (const at of [index - step, index + step]) if (values[at] !== undefined && values[at] !== null) return values[at];
    }
    return null;
  };
  const readout = (plot, groups) => (u) => {
    const index = u.cursor.idx;
    if (index === null || index === undefined || u.cursor.left < 0) return [];
    const parts = plot.series.filter((one) => u.series[groups.get(one.name)[0]].show).map((one) => {
      const values = groups.get(one.name).map((member) => number(nearest(u.data[member], index), 4));
      if (one.kind !== "band") return `${one.name}: ${values[0]}`;
      return `${one.name}: ${values.length === 3 ? `${values[2]} ` : ""}[${values[1]}, ${values[0]}]`;
    });
    return [`${plot.x_label}: ${number(u.data[0][index], 6)}`, ...parts];
  };

  // Long columns come as bytes (see html.py): gaps between evenly spaced abscissae, and 16-bit fractions of a range.
  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const abscissae = (x) => {
    if (Array.isArray(x)) return x;
    let at = 0;
    return Array.from(bytes(x.gaps), (gap) => Number((x.first + x.step * (at += gap)).toPrecision(12)));
  };
  const scaled = (y) => Array.from(new Uint16Array(bytes(y.codes).buffer), (code) => y.low + y.span * code / 65535);
  const ordinates = (y) => {
    if (Array.isArray(y)) return y;
    return y.log ? scaled(y).map((value) => 10 ** value) : scaled(y);
  };
  // Values at all lines: between those of a curve that the page holds they lie on a straight line.
  const spread = (lines, x, values) => {
    let j = 0;
    return lines.map((at) => {
      while (j < x.length - 2 && x[j + 1] <= at) j++;
      const share = x.length > 1 ? (at - x[j]) / (x[j + 1] - x[j]) : 0;
      return share ? values[j] + share * (values[j + 1] - values[j]) : values[j];
    });
  };
  const unpack = {
    lines: (plot) => {
      for (const one of plot.series) {
        one.x = abscissae(one.x);
        for (const name of ["y", "y_low", "y_high"]) one[name] = ordinates(one[name]);
      }
    },
    frf: (plot) => {
      for (const strip of plot.strips) { strip.x = abscissae(strip.x); strip.y = ordinates(strip.y); }
      plot.lines = plot.strips[0].x;
      for (const curve of [...plot.band, ...plot.curves]) {
        const x = abscissae(curve.x);
        curve.size = spread(plot.lines, x, ordinates(curve.size).map(Math.log10)).map((value) => 10 ** value);
        curve.angle = spread(plot.lines, x, ordinates(curve.angle));
      }
    },
    modes: () => {},
  };

  const RADIAN = Math.PI / 180;
  const real = (curve) => curve.size.map((size, i) => size * Math.cos(curve.angle[i] * RADIAN));
  const imaginary = (curve) => curve.size.map((size, i) => size * Math.sin(curve.angle[i] * RADIAN));
  const VIEWS = {
    "Magnitude": { log_y: true, of: (curve) => curve.size, label: (unit) => `|H| (${unit})`, band: true },
    "Linear": { of: (curve) => curve.size, label: (unit) => `|H| (${unit})`, band: true },
    "dB": { of: (curve) => curve.size.map((size) => 20 * Math.log10(size)), label: (unit) => `|H| (dB re 1 ${unit})`, band: true },
    "Phase": { of: (curve) => curve.angle, label: () => "Phase (°)", band: true },
    "Real": { of: real, label: (unit) => `Re H (${unit})` },
    "Imaginary": { of: imaginary, label: (unit) => `Im H (${unit})` },
    "Nyquist": { of: imaginary, label: (unit) => `Im H (${unit})` },
  };

  const csv = {
    lines: (plot) => {
      const names = [plot.x_label], tables = [];
      for (const one of plot.series) {
        const columns = [["y", ""], ["y_low", " lower"], ["y_high", " upper"]].filter(([key]) => one[key].length);
        names.push(...columns.map(([, end]) => one.name + end));
        tables.push([one.x, ...columns.map(([key]) => one[key])]);
      }
      return [names, uPlot.join(tables)];
    },
    frf: (plot) => {
      const names = ["Frequency (Hz)"], columns = [plot.lines];
      for (const curve of plot.curves) {
        names.push(`${curve.name} real (${plot.unit})`, `${curve.name} imaginary (${plot.unit})`);
        columns.push(real(curve), imaginary(curve));
      }
      plot.band.forEach((curve, i) => {
        const end = ["2.5 %", "97.5 %"][i];
        names.push(`|H| ${end} (${plot.unit})`, `phase ${end} (deg)`);
        columns.push(curve.size, curve.angle);
      });
      for (const strip of plot.strips) { names.push(strip.name); columns.push(strip.y); }
      return [names, columns];
    },
    modes: (plot) => {
      const pick = (flat, side) => flat.filter((_, i) => i % 2 === side).map((value) => value * plot.size / 10000);
      const names = ["x (m)", "y (m)"], columns = [pick(plot.points, 0), pick(plot.points, 1)];
      for (const mode of plot.modes) {
        names.push(`${mode.name} dx`, `${mode.name} dy`);
        columns.push(pick(mode.shape, 0), pick(mode.shape, 1));
      }
      return [names, columns];
    },
  };
  const csvText = (plot) => {
    const [names, columns] = csv[plot.kind ?? "lines"](plot);
    const quoted = names.map((name) => `"${name.replace(/"/g, '""')}"`).join(",");
    const cell = (value, j) => value === undefined || value === null ? "" : String(Number(value.toPrecision(j ? 5 : 12)));
    return [quoted, ...columns[0].map((_, i) => columns.map((column, j) => cell(column[i], j)).join(","))].join("\n") + "\n";
  };
  const save = (name, type, text) => {
    const link = element("a", { download: name, href: URL.createObjectURL(new Blob([text], { type })) });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
  };


  const ADVICE = "Drag to zoom, double-click to reset; arrow keys move the cursor, + and − zoom.";
  // What stands around the charts of a figure: a line to read values off, a button to leave a zoom, and the keyboard.
  const frame = (live, name) => {
    const stage = element("div", { className: "stage", tabIndex: 0 });
    const text = element("span", { className: "mouse", textContent: ADVICE });
    const reset = element("button", { type: "button", textContent: "Reset zoom", hidden: true });
    stage.setAttribute("role", "application");
    stage.setAttribute("aria-label", `${name}: interactive plot. ${ADVICE}`);
    stage.addEventListener("blur", () => text.removeAttribute("aria-live"));
    live.append(stage, element("p", { className: "hint" }, text, reset));
    const width = () => Math.max(200, Math.floor(live.clientWidth));
    return { stage, text, reset, width };
  };
  const keyboard = (parts, chart, zoom, full) => parts.stage.addEventListener("keydown", (event) => {
    const u = chart(), { min, max } = u.scales.x, over = u.over.clientWidth;
    const left = u.cursor.left >= 0 ? u.cursor.left : over / 2;
    const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key], factor = { "+": 0.5, "=": 0.5, "-": 2 }[event.key];
    const home = { 0: true, Escape: true }[event.key];
    if (event.ctrlKey || event.metaKey || event.altKey || !(step || factor || home)) return;
    event.preventDefault();
    parts.text.setAttribute("aria-live", "polite");
    if (step) return u.setCursor({ left: Math.min(over, Math.max(0, left + step * (event.shiftKey ? 10 : 1) * over / 200)), top: u.over.clientHeight / 2 });
    if (home) return zoom(full);
    const middle = u.posToVal(left, "x"), low = middle + (min - middle) * factor, high = middle + (max - middle) * factor;
    zoom({ min: Math.max(full.min, low), max: Math.min(full.max, high) });
  });
  const FREQUENCY = "Frequency (Hz)";
  // All figures over frequency share one cursor; a zoom is its own figure's.
  const cursor = (x_label) => ({
    drag: { x: true, y: false, setScale: true }, points: { show: false },
    ...(x_label === FREQUENCY ? { sync: { key: FREQUENCY, scales: ["x", null], filters: { pub: (type) => type === "mousemove" || type === "mouseleave" } } } : {}),
  });

  const drawLines = (plot, live, name, done) => {
    const { data, series, bands, groups } = prepare(plot);
    const loose = plot.series.some((one) => one.kind === "points" || one.x.length === 1);
    const full = { min: data[0][0], max: data[0][data[0].length - 1] };
    let chart;
    live.append(legend(plot.series, (one) => chart.batch(() => groups.get(one.name).forEach((index) => chart.setSeries(index, { show: !one.hidden })))));
    const parts = frame(live, name), read = readout(plot, groups);
    const size = () => ({ width: parts.width(), height: Math.round(Math.min(420, Math.max(260, parts.width() * 0.55))) });
    chart = new uPlot({
      ...size(), series, bands,
      legend: { show: false },
      padding: [10, 24, 0, 0],
      cursor: cursor(plot.x_label),
      scales: {
        x: { time: false, range: fitted(loose, full) },
        y: { distr: plot.log_y ? 3 : 1, range: padded(plot.log_y) },
      },
      axes: [axis("x", plot.x_label, false, false), axis("y", plot.y_label, plot.log_y, true)],
      hooks: {
        draw: [done],
        setScale: [(u, key) => { if (key === "x") parts.reset.hidden = u.scales.x.min <= full.min && u.scales.x.max >= full.max; }],
        setCursor: [(u) => { parts.text.textContent = read(u).join(" · ") || ADVICE; parts.text.classList.toggle("readout", u.cursor.left >= 0); }],
      },
    }, data, parts.stage);
    const zoom = (range) => chart.setScale("x", range);
    parts.reset.addEventListener("click", () => zoom(full));
    keyboard(parts, () => chart, zoom, full);
    new ResizeObserver(() => { const next = size(); if (next.width !== chart.width) chart.setSize(next); }).observe(live);
  };

  // A dotted line across a chart at one frequency.
  const dotted = (u, value) => {
    const x = u.valToPos(value, "x", true), { left, width, top, height } = u.bbox;
    if (x < left || x > left + width) return;
    u.ctx.save();
    u.ctx.setLineDash([2 * devicePixelRatio, 3 * devicePixelRatio]);
    u.ctx.strokeStyle = "#5b6672";
    u.ctx.beginPath();
    u.ctx.moveTo(x, top);
    u.ctx.lineTo(x, top + height);
    u.ctx.stroke();
    u.ctx.restore();
  };

  const STRIP = 84;
  const drawFrf = (plot, live, name, done) => {
    const lines = plot.lines, full = { min: lines[0], max: lines[lines.length - 1] };
    const layers = [{ name: "95 % band", kind: "band", colour: plot.band[0].colour, x: lines, y: [], hidden: false }, ...plot.curves.map((curve) => ({ ...curve, kind: "line", x: lines, width: curve === plot.curves[0] ? 1.2 : 1.75 }))];
    let shown = { ...full }, charts = [], view, at = null;
    const chosen = switches("View", Object.keys(VIEWS), (label) => { view = label; build(); });
    const list = legend(layers, () => build());
    live.append(chosen.group, list);
    const parts = frame(live, name);
    const zoom = (range) => { shown = { ...range }; charts.forEach((one) => one.zoom(shown)); parts.reset.hidden = shown.min <= full.min && shown.max >= full.max; };
    const tell = () => {
      const said = charts.flatMap((one, i) => one.read().slice(i ? 1 : 0));
      parts.text.textContent = said.join(" · ") || ADVICE;
      parts.text.classList.toggle("readout", said.length > 0);
    };

    const overFrequency = (content, height, last) => {
      const { data, series, bands, groups } = prepare(content), read = readout(content, groups);
      const bottom = { ...axis("x", last ? FREQUENCY : undefined, false, false), ...(last ? {} : { size: 6, labelSize: 0, values: () => [] }) };
      const chart = new uPlot({
        width: parts.width(), height, series, bands,
        legend: { show: false },
        padding: [10, 24, 0, 0],
        cursor: { ...cursor(FREQUENCY), drag: { x: true, y: false, setScale: false }, bind: { dblclick: () => () => zoom(full) } },
        scales: { x: { time: false, range: (u, min, max) => [min, max] }, y: { distr: content.log_y ? 3 : 1, range: content.range ?? padded(content.log_y) } },
        axes: [bottom, { ...axis("y", content.y_label, content.log_y, true), size: side() - 20 }],
        hooks: {
          ready: [(u) => u.setScale("x", shown)],
          draw: [done, (u) => dotted(u, plot.worst)],
          setSelect: [(u) => {
            const { left, width } = u.select;
            u.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
            if (width > 0) zoom({ min: u.posToVal(left, "x"), max: u.posToVal(left + width, "x") });
          }],
          setCursor: [(u) => { at = u.cursor.left < 0 ? null : u.cursor.idx; charts.forEach((one) => one.mark?.()); tell(); }],
        },
      }, data, parts.stage);
      return { chart, zoom: (range) => chart.setScale("x", range), read: () => read(chart), resize: (width) => chart.setSize({ width, height: chart.height }) };
    };

    // Real against imaginary part of the lines that are zoomed to, as wide as high on the screen; a dot where the cursor is.
    const nyquist = (height) => {
      const curves = layers.slice(1).filter((one) => !one.hidden).map((one) => ({ ...one, re: real(one), im: imaginary(one) }));
      const inside = () => lines.flatMap((f, i) => f >= shown.min && f <= shown.max ? [i] : []);
      const limits = () => {
        const ends = [[Infinity, -Infinity], [Infinity, -Infinity]];
        for (const i of inside()) for (const one of curves) [one.re[i], one.im[i]].forEach((value, side) => { ends[side] = [Math.min(ends[side][0], value), Math.max(ends[side][1], value)]; });
        const box = [parts.width() - side() - 24, height - 58];
        const per = Math.max(...ends.map(([low, high], side) => 1.08 * (high - low) / box[side])) || 1;
        return ends.map(([low, high], side) => [(low + high - per * box[side]) / 2, (low + high + per * box[side]) / 2]);
      };
      const path = (u, index) => {
        const one = curves[index - 1], stroke = new Path2D();
        inside().forEach((i, n) => stroke[n ? "lineTo" : "moveTo"](u.valToPos(one.re[i], "x", true), u.valToPos(one.im[i], "y", true)));
        return { stroke, clip: null, fill: null, flags: 1 };
      };
      let range = limits();
      const chart = new uPlot({
        mode: 2, width: parts.width(), height, legend: { show: false }, padding: [10, 24, 0, 0],
        cursor: { show: false },
        series: [{}, ...curves.map((one) => ({ stroke: one.colour, width: one.width, dash: one.dashed ? [7, 4] : undefined, paths: path, points: { show: false }, facets: [{ scale: "x", auto: true }, { scale: "y", auto: true }] }))],
        scales: { x: { time: false, range: () => range[0] }, y: { range: () => range[1] } },
        axes: [axis("x", `Re H (${plot.unit})`, false, false), { ...axis("y", `Im H (${plot.unit})`, false, true), size: side() - 20 }],
        hooks: {
          draw: [done, (u) => {
            if (at === null) return;
            for (const one of curves) {
              u.ctx.beginPath();
              u.ctx.arc(u.valToPos(one.re[at], "x", true), u.valToPos(one.im[at], "y", true), 5 * devicePixelRatio, 0, 2 * Math.PI);
              u.ctx.fillStyle = one.colour;
              u.ctx.fill();
            }
          }],
        },
      }, [null, ...curves.map((one) => [one.re, one.im])], parts.stage);
      const again = () => { range = limits(); chart.redraw(true, true); chart.setScale("x", { min: range[0][0], max: range[0][1] }); chart.setScale("y", { min: range[1][0], max: range[1][1] }); };
      const read = () => at === null ? [] : [`${FREQUENCY}: ${number(lines[at], 6)}`, ...curves.map((one) => `${one.name}: ${number(one.re[at], 4)} ${one.im[at] < 0 ? "−" : "+"} ${number(Math.abs(one.im[at]), 4)} i`)];
      return { chart, zoom: again, mark: () => chart.redraw(false, false), read, resize: (width) => { chart.setSize({ width, height }); again(); } };
    };

    const side = () => ["Linear", "Real", "Imaginary", "Nyquist"].includes(view) ? 104 : 74;
    const build = () => {
      charts.forEach((one) => one.chart.destroy());
      charts = [];
      const style = VIEWS[view], height = Math.round(Math.min(360, Math.max(220, parts.width() * 0.42)));
      const series = layers.filter((one) => one.kind !== "band" || style.band).map((one) => one.kind === "band"
        ? { ...one, y_low: style.of(plot.band[0]), y_high: style.of(plot.band[1]) }
        : { ...one, y: style.of(one) });
      list.firstChild.firstChild.disabled = !style.band;
      const made = [view === "Nyquist" ? nyquist(height + 60) : overFrequency({ x_label: FREQUENCY, y_label: style.label(plot.unit), log_y: style.log_y ?? false, series }, height, false)];
      plot.strips.forEach((strip, i) => {
        const content = { x_label: FREQUENCY, y_label: strip.name, log_y: false, series: [{ name: strip.name, kind: "line", colour: plot.curves[0].colour, x: lines, y: strip.y, width: 0.8 }] };
        if (strip.name === "Coherence") content.range = (u, min) => [Math.min(0.9, min), 1.005];
        const last = i === plot.strips.length - 1;
        made.push(overFrequency(content, last ? STRIP + 48 : STRIP, last));
      });
      charts = made;
      tell();
    };
    chosen.press("Magnitude");
    parts.reset.addEventListener("click", () => zoom(full));
    keyboard(parts, () => charts[charts.length - 1].chart, zoom, full);
    new ResizeObserver(() => { const width = parts.width(); if (charts.length && width !== charts[0].chart.width) charts.forEach((one) => one.resize(width)); }).observe(live);
  };

  // Modes swing at one visible rate, whatever their frequency; two seconds a cycle.
  const drawModes = (plot, live, name, done) => {
    const canvas = element("canvas"), context = canvas.getContext("2d");
    const still = matchMedia("(prefers-reduced-motion: reduce)");
    let chosen = plot.modes, playing = !still.matches, visible = false, phase = 0, last = null, waiting = false;
    const xs = plot.points.filter((_, i) => i % 2 === 0), ys = plot.points.filter((_, i) => i % 2 === 1);
    const reach = (mode, side) => Math.max(...mode.shape.filter((_, i) => i % 2 === side).map(Math.abs));
    const wide = (modes) => [Math.min(...xs) - Math.max(...modes.map((m) => reach(m, 0))), Math.max(...xs) + Math.max(...modes.map((m) => reach(m, 0)))];
    const high = (modes) => [Math.min(...ys) - Math.max(...modes.map((m) => reach(m, 1))), Math.max(...ys) + Math.max(...modes.map((m) => reach(m, 1)))];
    const paint = () => {
      const width = Math.max(200, live.clientWidth), columns = Math.min(chosen.length, Math.max(1, Math.floor(width / 250)));
      const [left, right] = wide(plot.modes), [bottom, top] = high(plot.modes);
      const cell = width / columns, scale = Math.min((cell - 24) / (right - left), (chosen.length > 1 ? 240 : 380) / (top - bottom));
      const tall = scale * (top - bottom) + 48, rows = Math.ceil(chosen.length / columns), dots = devicePixelRatio;
      if (canvas.width !== Math.round(width * dots) || canvas.height !== Math.round(rows * tall * dots)) {
        canvas.width = Math.round(width * dots);
        canvas.height = Math.round(rows * tall * dots);
      }
      context.setTransform(dots, 0, 0, dots, 0, 0);
      context.clearRect(0, 0, width, rows * tall);
      context.lineJoin = context.lineCap = "round";
      chosen.forEach((mode, n) => {
        const x0 = (n % columns + 0.5) * cell, y0 = Math.floor(n / columns) * tall + 42 + (tall - 48) / 2;
        const strokes = (swing, colour, thickness) => {
          context.beginPath();
          for (let i = 0; i < xs.length; i++) {
            const x = x0 + scale * (xs[i] + swing * mode.shape[2 * i] - (left + right) / 2);
            const y = y0 - scale * (ys[i] + swing * mode.shape[2 * i + 1] - (bottom + top) / 2);
            context[i % plot.run ? "lineTo" : "moveTo"](x, y);
          }
          context.strokeStyle = colour;
          context.lineWidth = thickness;
          context.stroke();
        };
        strokes(0, "#a9b3bc", 1.25);
        strokes(Math.cos(phase), "#1f5a94", 2.5);
        context.fillStyle = INK;
        context.textAlign = "center";
        const [title, interval] = mode.name.split(" (");
        context.font = `600 ${FONT}`;
        context.fillText(title, x0, y0 - (tall - 48) / 2 - 26, cell);
        context.font = FONT;
        if (interval) context.fillText(`95 %: ${interval.replace(")", "")}`, x0, y0 - (tall - 48) / 2 - 10, cell);
      });
      done();
    };
    const step = (now) => {
      waiting = false;
      if (last !== null) phase = (phase + Math.PI * Math.min(now - last, 100) / 1000) % (2 * Math.PI);
      last = now;
      paint();
      canvas.dataset.phase = phase.toFixed(2);
      run();
    };
    const run = () => {
      if (playing && visible && !waiting) { waiting = true; requestAnimationFrame(step); }
      if (!playing || !visible) last = null;
    };
    const play = element("button", { type: "button", className: "play" });
    const label = () => { play.textContent = playing ? "Pause" : "Play"; };
    play.addEventListener("click", () => { playing = !playing; label(); run(); });
    label();
    const titles = plot.modes.map((mode) => mode.name.split(":")[0]);
    const { group, press } = switches("Modes shown", ["All", ...titles], (title) => { chosen = title === "All" ? plot.modes : [plot.modes[titles.indexOf(title)]]; paint(); });
    group.prepend(play);
    canvas.setAttribute("aria-hidden", "true");
    live.append(group, canvas);
    press("All");
    new IntersectionObserver((seen) => { visible = seen[seen.length - 1].isIntersecting; run(); }).observe(canvas);
    new ResizeObserver(() => paint()).observe(live);
  };

  const PLOTS = { lines: drawLines, frf: drawFrf, modes: drawModes };
  const plots = new Map();
  const plotOf = (paper) => {
    const script = paper.querySelector("script.plot");
    if (script && !plots.has(paper)) {
      const plot = JSON.parse(script.textContent);
      unpack[plot.kind ?? "lines"](plot);
      plots.set(paper, plot);
    }
    return plots.get(paper);
  };
  const draw = (paper) => {
    const live = paper.querySelector(".live"), plot = plotOf(paper);
    const name = paper.parentElement.querySelector("figcaption b").textContent.replace(/\.$/, "");
    live.hidden = false;
    paper.classList.add("drawn");
    try {
      PLOTS[plot.kind ?? "lines"](plot, live, name, () => {
        if (!paper.dataset.drawn) performance.mark("figure drawn");
        paper.dataset.drawn = "true";
      });
    } catch (error) {
      // The static figure says the same; a broken plot must not hide it.
      paper.classList.remove("drawn");
      live.hidden = true;
      console.error(error);
    }
  };
  // Figures are drawn as the reader comes near them: a long report is there at once.
  const near = new IntersectionObserver((entries) => {
    for (const entry of entries) if (entry.isIntersecting) { near.unobserve(entry.target); draw(entry.target); }
  }, { rootMargin: "600px" });

  // Comments stay in this browser, where it lets a page keep anything, until they are exported.
  const KEY = `jointbayes comments ${location.pathname}`;
  const comments = {};
  try { Object.assign(comments, JSON.parse(localStorage.getItem(KEY) ?? "{}")); } catch { /* it does not */ }
  const count = element("button", { type: "button" });
  const keep = () => {
    const written = Object.keys(comments).length;
    count.textContent = `Export ${written || ""} comment${written === 1 ? "" : "s"} (JSON)`.replace("  ", " ");
    count.disabled = !written;
    try { localStorage.setItem(KEY, JSON.stringify(comments)); } catch { /* it does not */ }
  };
  const figures = [...document.querySelectorAll("figure")];
  for (const figure of figures) {
    const paper = figure.querySelector(".paper"), name = figure.querySelector("figcaption b").textContent.replace(/\.$/, "");
    const button = (text, label, act) => {
      const made = element("button", { type: "button", textContent: text });
      made.setAttribute("aria-label", `${label} of ${name}`);
      made.addEventListener("click", act);
      return made;
    };
    const tools = element("div", { className: "tools" });
    if (paper.querySelector("script.plot")) {
      tools.append(button("CSV", "Data (CSV)", () => save(`${figure.id}.csv`, "text/csv", csvText(plotOf(paper)))));
      near.observe(paper);
    }
    const image = paper.querySelector("img");
    tools.append(button("SVG", "Picture (SVG)", () => save(`${figure.id}.svg`, "image/svg+xml", decodeURIComponent(image.src.slice(image.src.indexOf(",") + 1)))));
    const box = element("textarea", { rows: 3, value: comments[figure.id] ?? "", placeholder: "Comment", hidden: !comments[figure.id] });
    box.setAttribute("aria-label", `Comment on ${name}`);
    box.addEventListener("input", () => {
      if (box.value.trim()) comments[figure.id] = box.value; else delete comments[figure.id];
      keep();
    });
    const open = button("Comment", "Comment", () => { box.hidden = !box.hidden; open.setAttribute("aria-expanded", String(!box.hidden)); if (!box.hidden) box.focus(); });
    open.setAttribute("aria-label", `Comment on ${name}`);
    open.setAttribute("aria-expanded", String(!box.hidden));
    tools.append(open);
    figure.append(tools, box);
  }
  if (figures.length) {
    count.addEventListener("click", () => save("comments.json", "application/json", JSON.stringify({
      report: document.title,
      date: document.querySelector("time").dateTime,
      comments: figures.filter((figure) => comments[figure.id]).map((figure) => ({
        figure: figure.id, caption: figure.querySelector("figcaption").textContent, comment: comments[figure.id],
      })),
    }, null, 2) + "\n"));
    document.querySelector("main").append(element("p", { className: "export" }, count));
    keep();
  }

  // Mark in the table of contents the section that is being read.
  const links = new Map([...document.querySelectorAll(".contents a")].map((link) => [link.hash.slice(1), link]));
  const sections = [...document.querySelectorAll(".body > section")];
  const mark = () => {
    const current = sections.filter((section) => section.getBoundingClientRect().top < innerHeight * 0.3).pop();
    for (const link of links.values()) link.removeAttribute("aria-current");
    if (current) links.get(current.id)?.setAttribute("aria-current", "true");
  };
  if (links.size) {
    addEventListener("scroll", mark, { passive: true });
    mark();
  }
})();
