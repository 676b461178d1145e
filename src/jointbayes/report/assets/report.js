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

  // One list of x with a hole wherever a series has no value there: uPlot draws through undefined.
  const prepare = (plot) => {
    const rank = { band: 0, line: 1, points: 2 };
    const ordered = plot.series.slice().sort((a, b) => rank[a.kind] - rank[b.kind]);
    const tables = [], series = [{}], bands = [], groups = new Map();
    for (const one of ordered) {
      const columns = [one.x], members = [];
      const add = (values, options) => { columns.push(values); members.push(series.length); series.push({ spanGaps: false, ...options }); };
      if (one.kind === "band") {
        const edge = { stroke: translucent(one.colour, 0.35), width: 1, points: { show: false } };
        bands.push({ series: [series.length, series.length + 1], fill: translucent(one.colour, 0.18) });
        add(one.y_high, edge);
        add(one.y_low, edge);
      }
      if (one.kind === "points") {
        add(one.y, { paths: () => null, points: { show: true, size: one.x.length > 60 ? 4 : 6, stroke: one.colour, fill: one.colour } });
      } else if (one.y.length) {
        add(one.y, { stroke: one.colour, width: 1.75, dash: one.dashed ? [7, 4] : undefined, points: { show: one.x.length === 1 } });
      }
      tables.push(columns);
      groups.set(one, members);
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
    else if (one.y.length) draw("line", { x1: 1, x2: 27, y1: 6, y2: 6, stroke: one.colour, "stroke-width": 2, ...(one.dashed ? { "stroke-dasharray": "6 4" } : {}) });
    return space;
  };

  const legend = (plot, chart, groups) => {
    const list = document.createElement("ul");
    list.className = "legend";
    for (const one of plot.series) {
      const button = document.createElement("button");
      button.type = "button";
      button.setAttribute("aria-pressed", "true");
      button.append(swatch(one), one.name);
      button.addEventListener("click", () => {
        const show = button.getAttribute("aria-pressed") !== "true";
        button.setAttribute("aria-pressed", String(show));
        chart().batch(() => groups.get(one).forEach((index) => chart().setSeries(index, { show })));
      });
      const item = document.createElement("li");
      item.append(button);
      list.append(item);
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
    if (index === null || index === undefined || u.cursor.left < 0) return "";
    const parts = plot.series.filter((one) => u.series[groups.get(one)[0]].show).map((one) => {
      const values = groups.get(one).map((member) => number(nearest(u.data[member], index), 4));
      if (one.kind !== "band") return `${one.name}: ${values[0]}`;
      return `${one.name}: ${values.length === 3 ? `${values[2]} ` : ""}[${values[1]}, ${values[0]}]`;
    });
    return [`${plot.x_label}: ${number(u.data[0][index], 6)}`, ...parts].join(" · ");
  };

  // Long columns come as bytes (see html.py): gaps between evenly spaced abscissae, and 16-bit fractions of a range.
  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const abscissae = (x) => {
    if (Array.isArray(x)) return x;
    let at = 0;
    return Array.from(bytes(x.gaps), (gap) => Number((x.first + x.step * (at += gap)).toPrecision(12)));
  };
  const ordinates = (y) => {
    if (Array.isArray(y)) return y;
    const scaled = Array.from(new Uint16Array(bytes(y.codes).buffer), (code) => y.low + y.span * code / 65535);
    return y.log ? scaled.map((value) => 10 ** value) : scaled;
  };
  const unpack = (plot) => {
    for (const one of plot.series) {
      one.x = abscissae(one.x);
      for (const name of ["y", "y_low", "y_high"]) one[name] = ordinates(one[name]);
    }
    return plot;
  };

  const draw = (paper) => {
    const plot = unpack(JSON.parse(paper.querySelector("script.plot").textContent));
    const live = paper.querySelector(".live");
    const { data, series, bands, groups } = prepare(plot);
    const loose = plot.series.some((one) => one.kind === "points" || one.x.length === 1);
    const hint = document.createElement("p"), text = document.createElement("span"), reset = document.createElement("button");
    const advice = "Drag to zoom, double-click to reset. Click a legend entry to hide it.";
    hint.className = "hint";
    text.className = "mouse";
    text.textContent = advice;
    reset.type = "button";
    reset.textContent = "Reset zoom";
    reset.hidden = true;
    hint.append(text, reset);

    let chart;
    const size = () => {
      const width = Math.max(200, Math.floor(live.clientWidth));
      return { width, height: Math.round(Math.min(420, Math.max(260, width * 0.55))) };
    };
    const full = { min: data[0][0], max: data[0][data[0].length - 1] };
    live.append(legend(plot, () => chart, groups));
    live.hidden = false;
    paper.classList.add("drawn");
    const read = readout(plot, groups);
    chart = new uPlot({
      ...size(), series, bands,
      legend: { show: false },
      padding: [10, 24, 0, 0],
      cursor: { drag: { x: true, y: false, setScale: true }, points: { show: false } },
      scales: {
        x: { time: false, range: fitted(loose, full) },
        y: { distr: plot.log_y ? 3 : 1, range: padded(plot.log_y) },
      },
      axes: [axis("x", plot.x_label, false, false), axis("y", plot.y_label, plot.log_y, true)],
      hooks: {
        draw: [() => { paper.dataset.drawn = "true"; }],
        setScale: [(u, key) => { if (key === "x") reset.hidden = u.scales.x.min <= full.min && u.scales.x.max >= full.max; }],
        setCursor: [(u) => { text.textContent = read(u) || advice; text.classList.toggle("readout", u.cursor.left >= 0); }],
      },
    }, data, live);
    reset.addEventListener("click", () => chart.setScale("x", full));
    live.append(hint);
    new ResizeObserver(() => { const next = size(); if (next.width !== chart.width) chart.setSize(next); }).observe(live);
  };

  for (const script of document.querySelectorAll("script.plot")) {
    const paper = script.closest(".paper");
    try {
      draw(paper);
    } catch (error) {
      // The static figure says the same; a broken plot must not hide it.
      paper.classList.remove("drawn");
      paper.querySelector(".live").hidden = true;
      console.error(error);
    }
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
