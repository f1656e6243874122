"use strict";
(() => {
  // tables: copied as CSV, with the numbers behind the digits shown
  const csvOf = (table) => {
    const quote = (s) => (/[",\n]/.test(s) ? '"' + s.replace(/"/g, '""') + '"' : s);
    const text = (c) => {
      if (c.dataset.v !== undefined) return c.dataset.v;
      const long = c.querySelector("details.name");
      const own = long ? long.lastChild.textContent : c.textContent;
      return own.trim().replace(/\s+/g, " ").replace(/−/g, "-");
    };
    return [...table.rows].map((r) => [...r.cells].map((c) => quote(text(c))).join(",")).join("\n") + "\n";
  };
  const copy = async (text) => {
    try { await navigator.clipboard.writeText(text); return true; } catch { /* a page from a disk may not */ }
    const area = document.createElement("textarea");
    area.value = text;
    document.body.append(area);
    area.select();
    const done = document.execCommand("copy");
    area.remove();
    return done;
  };
  document.querySelectorAll("button.csv").forEach((b) => b.addEventListener("click", async () => {
    const part = b.closest(".tablepart");
    const done = await copy(csvOf(part.querySelector("table")));
    part.querySelector("[role=status]").textContent = done ? "copied" : "the browser does not allow copying";
  }));

  // folding
  const folds = [...document.querySelectorAll("section > details")];
  const button = document.querySelector(".fold");
  button.addEventListener("click", () => {
    const open = folds.some((d) => d.open);
    folds.forEach((d) => { d.open = !open; });
    button.textContent = open ? "unfold all" : "fold all";
  });
  const unfold = () => {
    const target = location.hash && document.getElementById(location.hash.slice(1));
    const fold = target && (target.querySelector(":scope > details") || target.closest("details"));
    if (fold) fold.open = true;
  };
  addEventListener("hashchange", unfold);
  unfold();
  let folded = [];
  addEventListener("beforeprint", () => { folded = folds.filter((d) => !d.open); folded.forEach((d) => { d.open = true; }); });
  addEventListener("afterprint", () => folded.forEach((d) => { d.open = false; }));

  // records to zoom into
  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer;
  const unpack = (p) => {
    if (!p) return null;
    const real = (text) => Float64Array.from(new Int16Array(bytes(text)), (k) => k === -32768 ? NaN : p.low + (k + 32766) / 65532 * p.span);
    const low = real(p.a);
    return { low, high: p.b ? real(p.b) : low };
  };
  const raised = (e) => String(e).replace(/./g, (c) => "⁰¹²³⁴⁵⁶⁷⁸⁹"[c] || "⁻");
  const label = (v, step) => {
    if (Math.abs(v) < step * 1e-6) return "0";
    const [mantissa, e] = Number(v.toPrecision(6)).toExponential().split("e").map(Number);
    const text = e < -4 || e > 5 ? `${Number(mantissa.toPrecision(4))}·10${raised(e)}` : String(Number(v.toPrecision(6)));
    return text.replace("-", "−");
  };
  const ticks = (low, high, count) => {
    let step = 1, out = [];
    for (let n = count; out.length < 3 && n < count + 9; n++) { // three at least
      const raw = (high - low) / (n - 1), base = 10 ** Math.floor(Math.log10(raw));
      step = [1, 2, 2.5, 5, 10].map((s) => s * base).find((s) => s >= raw * (1 - 1e-9));
      out = [];
      for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) out.push([k * step, label(k * step, step)]);
    }
    return out;
  };

  class Explorer {
    constructor(root) {
      this.root = root;
      this.data = JSON.parse(root.querySelector("script").textContent);
      this.clocks = this.data.clocks.map((c) => new Float32Array(bytes(c)));
      this.plots = [...root.querySelectorAll(".plot")];
      this.select = root.querySelector("select");
      this.select.addEventListener("change", () => this.show(Number(this.select.value)));
      root.querySelectorAll("[data-do]").forEach((b) => b.addEventListener("click", () => this.act(b.dataset.do)));
      const keys = { "+": "in", "=": "in", "-": "out", ArrowLeft: "left", ArrowRight: "right", 0: "all" };
      this.plots.forEach((p) => {
        p.addEventListener("keydown", (e) => { if (keys[e.key]) { e.preventDefault(); this.act(keys[e.key]); } });
        this.listen(p.querySelector(".area"));
      });
      this.show(this.data.first);
    }
    show(index) {
      const s = this.data.series[index];
      const same = this.series && this.series.clock === s.clock;
      this.series = s;
      this.select.value = String(index);
      this.time = this.clocks[s.clock];
      this.full = [this.time[0], s.end];
      if (!same) this.span = [...this.full];
      this.parts = { m: unpack(s.m), s: unpack(s.s), p: unpack(s.p), b: unpack(s.b) };
      this.draw();
      document.querySelectorAll(`[data-target="${this.root.dataset.name}"] tbody tr`).forEach((r, i) => r.classList.toggle("on", i === index));
    }
    act(what) {
      const [a, b] = this.span, width = b - a, middle = (a + b) / 2;
      const moves = { in: [middle - width / 4, middle + width / 4], out: [middle - width, middle + width],
        left: [a - width / 4, b - width / 4], right: [a + width / 4, b + width / 4], all: this.full };
      this.zoom(...moves[what]);
    }
    zoom(a, b) {
      const [first, last] = this.full;
      const width = Math.min(Math.max(b - a, (last - first) / 2e4), last - first);
      a = Math.min(Math.max(a, first), last - width);
      this.span = [a, a + width];
      this.draw();
    }
    listen(area) {
      let from = null, brush = null, start = null;
      const at = (e) => { const r = area.getBoundingClientRect(); return Math.min(Math.max((e.clientX - r.left) / r.width, 0), 1); };
      area.addEventListener("pointerdown", (e) => {
        if (e.button !== 0) return;
        from = at(e); start = [...this.span];
        area.setPointerCapture(e.pointerId);
        if (!e.shiftKey) { brush = document.createElement("div"); brush.className = "brush"; area.append(brush); }
      });
      area.addEventListener("pointermove", (e) => {
        if (from === null) return;
        const to = at(e);
        if (brush) { brush.style.left = `${100 * Math.min(from, to)}%`; brush.style.width = `${100 * Math.abs(to - from)}%`; }
        else { const d = (from - to) * (start[1] - start[0]); this.zoom(start[0] + d, start[1] + d); }
      });
      const end = (e) => {
        if (from === null) return;
        const to = at(e), [a, b] = start, zooms = brush && Math.abs(to - from) > 0.01;
        if (brush) brush.remove();
        if (zooms && e.type === "pointerup") this.zoom(a + Math.min(from, to) * (b - a), a + Math.max(from, to) * (b - a));
        from = brush = null;
      };
      area.addEventListener("pointerup", end);
      area.addEventListener("pointercancel", end);
      area.addEventListener("dblclick", () => this.act("all"));
      area.addEventListener("wheel", (e) => {
        if (!e.ctrlKey && !e.metaKey) return; // the wheel alone scrolls the page
        e.preventDefault();
        const [a, b] = this.span, t = a + at(e) * (b - a), f = Math.exp(e.deltaY / 300);
        this.zoom(t - (t - a) * f, t + (b - t) * f);
      }, { passive: false });
    }
    draw() {
      const [a, b] = this.span, t = this.time;
      let i = 0, j = t.length - 1;
      while (i < j && t[i + 1] <= a) i++;
      while (j > i && t[j - 1] >= b) j--;
      this.range = [i, j];
      const { m, s, p, b: before } = this.parts, width = 2 * (this.series.sigma || 0);
      const unit = this.series.unit ? ` [${this.series.unit}]` : "";
      this.panel(this.plots[0], [[m, "line s2"], [s, "thin s0"]], `value${unit}`, 0, 5);
      if (this.plots[1]) this.panel(this.plots[1], [[before, "thin s1"], [p, "thin s0"]], `${this.data.labels[2]}${unit}`, width, 4);
    }
    panel(plot, curves, name, width, count) {
      const [a, b] = this.span, [i, j] = this.range, t = this.time;
      let low = width ? -width : Infinity, high = width ? width : -Infinity;
      for (const [c] of curves) if (c) for (let k = i; k <= j; k++) { if (c.low[k] < low) low = c.low[k]; if (c.high[k] > high) high = c.high[k]; }
      if (!(high > low)) { const mid = Number.isFinite(low) ? low : 0; low = mid - 1; high = mid + 1; }
      const room = 0.04 * (high - low);
      low -= room; high += room;
      const X = (x) => (1000 * (x - a) / (b - a)).toFixed(1), Y = (y) => (1000 * (high - y) / (high - low)).toFixed(1);
      const wide = plot.querySelector(".area").clientWidth || 800;
      const xs = ticks(a, b, wide < 420 ? 4 : 7), ys = ticks(low, high, count);
      const line = (c) => {
        // one stretch or more to a pixel: least and largest of them
        const every = Math.max(1, Math.floor((j - i) / (wide * 1.5)));
        const exact = every === 1 && c.low === c.high;
        let out = "", pen = false;
        for (let k = i; k <= j; k += every) {
          let lo = Infinity, hi = -Infinity;
          for (let n = k; n < Math.min(k + every, j + 1); n++) { if (c.low[n] < lo) lo = c.low[n]; if (c.high[n] > hi) hi = c.high[n]; }
          if (!(hi >= lo)) { pen = false; continue; }
          out += `${pen ? "L" : "M"}${X(t[k])} ${Y(hi)}` + (exact || lo === hi ? "" : `L${X(t[k])} ${Y(lo)}`);
          pen = true;
        }
        return out;
      };
      let svg = `<path class="grid" d="${xs.map(([v]) => `M${X(v)} 0V1000`).join("")}${ys.map(([v]) => `M0 ${Y(v)}H1000`).join("")}"/>`;
      if (width) svg += `<path class="band s0" d="M0 ${Y(width)}H1000V${Y(-width)}H0Z"/>`;
      for (const [c, style] of curves) if (c) svg += `<path class="${style}" d="${line(c)}"/>`;
      plot.querySelector("svg").innerHTML = svg;
      plot.querySelector(".ylabel").textContent = name;
      const put = (where, side, entries, place) => { plot.querySelector(where).innerHTML = entries.map(([v, l]) => `<span style="${side}:${place(v)}%">${l}</span>`).join(""); };
      put(".xticks", "left", xs, (v) => (100 * (v - a) / (b - a)).toFixed(2));
      put(".yticks", "bottom", ys, (v) => (100 * (v - low) / (high - low)).toFixed(2));
      plot.dataset.span = `${a} ${b}`;
    }
  }
  const explorers = {};
  document.querySelectorAll(".traces").forEach((root) => { explorers[root.dataset.name] = new Explorer(root); });
  addEventListener("resize", () => Object.values(explorers).forEach((e) => e.draw()));
  document.querySelectorAll("[data-pick]").forEach((b) => b.addEventListener("click", () => {
    const found = explorers[b.closest("table").dataset.target];
    found.show(Number(b.dataset.pick));
    found.root.scrollIntoView({ block: "nearest" });
  }));
})();
