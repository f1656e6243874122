// Plays what the commands draw. `facts` and `commands` come from smsid.view.export; meshcat keeps the poses,
// this page keeps time, bends appendages, grows trails and tells the numbers.
const viewer = new MeshCat.Viewer(document.getElementById("meshcat-pane"));
for (const text of commands) {
  viewer.handle_command_bytearray(Uint8Array.from(atob(text), c => c.charCodeAt(0)));
}
if (facts.skies) { // the reader's system says whether it is day or night, and may change its mind
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const dress = () => {
    const name = dark.matches ? "space" : "light";
    document.body.className = name;
    for (const text of facts.skies[name]) {
      viewer.handle_command_bytearray(Uint8Array.from(atob(text), c => c.charCodeAt(0)));
    }
    viewer.set_dirty();
  };
  dark.addEventListener("change", dress);
  if (dark.matches) dress();
}
const find = id => document.getElementById(id);
const node = path => viewer.scene_tree.find(["meshcat"].concat(path.split("/"))).object;
const floats = text => new Float32Array(Uint8Array.from(atob(text), c => c.charCodeAt(0)).buffer);
viewer.gui.domElement.style.display = "none"; // meshcat's own controls: key c

for (const note of facts.notes) {
  const item = document.createElement("li");
  item.textContent = note;
  find("notes").appendChild(item);
}

// The camera was placed for a window of facts.aspect; a narrower one is looked at from farther away.
// The picture is moved up, off the bar, and left where a legend stands at the right; side by side it is
// wide and low, and goes below the legend.
let away = 1;
function fit() {
  const wanted = (facts.stop > facts.start ? 1.06 : 1) * Math.max(1, facts.aspect * innerHeight / innerWidth);
  const right = facts.layers.length && !facts.beside && innerWidth > 1000 ? 0.05 * innerWidth : 0;
  const up = facts.beside ? -0.13 * innerHeight : facts.stop > facts.start ? 28 : 0;
  viewer.camera.position.multiplyScalar(wanted / away);
  viewer.camera.setViewOffset(innerWidth, innerHeight, right, up, innerWidth, innerHeight);
  away = wanted;
  viewer.set_dirty();
}
addEventListener("resize", fit);
fit();

// Appendages: the strips of a surface between edges that the modes move. Twin of Surface.strip_poses.
const bends = facts.bends.map(b => ({
  step: b.step, modes: b.modes, edges: floats(b.edges), twist: floats(b.twist), delta: floats(b.delta),
  nodes: b.paths.map(node),
}));
function bendStrips(bend, first, part, factor) {
  const { step, modes, edges, twist, delta } = bend;
  const amount = [];
  for (let m = 0; m < modes; m++) {
    const next = Math.min((first + 1) * modes + m, delta.length - modes + m);
    amount.push(factor * ((1 - part) * delta[first * modes + m] + part * delta[next]));
  }
  const edge = k => {
    const p = [k * step, 0, 0];
    for (let m = 0; m < modes; m++) for (let i = 0; i < 3; i++) p[i] += amount[m] * edges[(k * modes + m) * 3 + i];
    return p;
  };
  let a = edge(0);
  bend.nodes.forEach((strip, k) => {
    const b = edge(k + 1);
    const chord = [b[0] - a[0], b[1] - a[1], b[2] - a[2]];
    const size = Math.hypot(...chord);
    const x = chord.map(c => c / size);
    let angle = 0;
    for (let m = 0; m < modes; m++) angle += amount[m] * twist[k * modes + m];
    const c = Math.cos(angle), s = Math.sin(angle);
    let z = [x[1] * s - x[2] * c, -x[0] * s, x[0] * c]; // x times (0, c, s)
    const length = Math.hypot(...z);
    z = z.map(v => v / length);
    const y = [z[1] * x[2] - z[2] * x[1], z[2] * x[0] - z[0] * x[2], z[0] * x[1] - z[1] * x[0]];
    const r = size / step;
    strip.matrix.set(
      x[0] * r, y[0], z[0], (a[0] + b[0]) / 2,
      x[1] * r, y[1], z[1], (a[1] + b[1]) / 2,
      x[2] * r, y[2], z[2], (a[2] + b[2]) / 2,
      0, 0, 0, 1);
    strip.matrix.decompose(strip.position, strip.quaternion, strip.scale);
    a = b;
  });
}

// Tubes along the ways of the tools, as far as they have come.
const trails = facts.trails.map(t => ({ ...t, object: node(t.path + "/<object>") }));
function growTrails(share) {
  for (const t of trails) t.object.geometry.setDrawRange(0, t.indices * Math.round(share * t.pieces));
}

// The legend: what can be switched off, with numbers where there are some.
function swatch(color) {
  const mark = document.createElement("span");
  mark.className = "swatch";
  mark.style.background = color;
  return mark;
}
function toggle(text, color, paths, shown = true) {
  const label = document.createElement("label"), box = document.createElement("input");
  box.type = "checkbox";
  box.checked = shown;
  box.onchange = () => { for (const path of paths) node(path).visible = box.checked; viewer.set_dirty(); };
  label.append(box, swatch(color), text);
  return label;
}
const cells = [];
function row(content, values) {
  const line = find("rows").insertRow();
  line.insertCell().append(content);
  const cell = line.insertCell();
  if (values) cells.push({ cell, unit: values.unit, values: floats(values.values) });
}
for (const motion of facts.motions) find("motions").append(toggle(motion.label, motion.color, [motion.path]));
for (const layer of facts.layers) {
  row(toggle(layer.name, layer.color, layer.paths), facts.readouts.find(r => r.layer === layer.name));
}
for (const readout of facts.readouts.filter(r => !r.layer)) {
  const text = document.createElement("span");
  text.className = "indent";
  text.textContent = readout.label;
  row(text, readout);
}
const tell = x => x >= 1000 ? x.toFixed(0) : x >= 100 ? x.toFixed(1) : x >= 1 ? x.toFixed(2) : x.toFixed(3);
find("panel").hidden = !facts.layers.length;
find("panel").open = innerWidth > 700;

if (facts.stop > facts.start) {
  const player = viewer.animator;
  const seconds = () => facts.start + player.time * facts.speed;
  const asked = name => {
    const found = new RegExp("[#&]" + name + "=([-+.\\deE]+)").exec(location.hash);
    return found ? Number(found[1]) : undefined;
  };
  const frames = 1 + Math.round((facts.stop - facts.start) / facts.speed * facts.rate);
  let factor = asked("bend") || facts.factor, drawn = "";
  const draw = () => {
    const key = Math.min(frames - 1, Math.max(0, player.time * facts.rate));
    if (drawn === key + " " + factor) return;
    drawn = key + " " + factor;
    const first = Math.min(Math.floor(key + 1e-4), frames - 1);
    for (const bend of bends) bendStrips(bend, first, Math.max(0, key - first), factor);
    growTrails(key / (frames - 1));
    for (const { cell, unit, values } of cells) cell.textContent = tell(values[Math.round(key)]) + " " + unit;
    viewer.set_dirty();
  };
  const update = player.update.bind(player);
  player.update = () => { update(); draw(); }; // meshcat calls it before it renders
  const go = t => {
    const at = (Math.min(facts.stop, Math.max(facts.start, t)) - facts.start) / facts.speed;
    player.seek(at);
    player.display_progress(at);
  };

  const seek = find("seek");
  seek.min = facts.start;
  seek.max = facts.stop;
  find("bar").hidden = false;
  find("play").onclick = () => player.playing ? player.pause() : player.play();
  seek.oninput = () => { player.pause(); go(Number(seek.value)); };

  const speeds = [0.1, 0.25, 0.5, 1, 2, 5, 10, 20, 50];
  if (!speeds.includes(facts.speed)) speeds.push(facts.speed);
  for (const s of speeds.sort((a, b) => a - b)) find("speed").add(new Option("\u00d7 " + s, s, false, s === facts.speed));
  find("speed").onchange = () => { player.mixer.timeScale = Number(find("speed").value) / facts.speed; };

  find("bending").hidden = !bends.length;
  const showFactor = () => { find("times").textContent = "\u00d7 " + (factor < 10 ? Math.round(10 * factor) / 10 : Math.round(factor)); };
  find("factor").value = Math.log10(factor);
  find("factor").oninput = () => { factor = 10 ** Number(find("factor").value); showFactor(); };
  showFactor();

  addEventListener("keydown", e => {
    if (e.target.tagName === "SELECT" || e.ctrlKey || e.metaKey || e.altKey) return;
    if (e.code === "Space" && e.target.type !== "checkbox" && e.target.tagName !== "SUMMARY") {
      e.preventDefault();
      find("play").click();
    } else if (e.code.startsWith("Arrow") && e.target.type !== "range") {
      player.pause();
      go(seconds() + (e.code === "ArrowLeft" || e.code === "ArrowDown" ? -1 : 1) * facts.speed / facts.rate);
    } else if (e.key === "c") {
      const style = viewer.gui.domElement.style;
      style.display = style.display ? "" : "none";
    }
  });
  const show = () => {
    find("play").textContent = player.playing ? "\u275A\u275A" : "\u25B6\uFE0E";
    find("time").textContent = seconds().toFixed(1) + " / " + facts.stop.toFixed(1) + " s";
    if (document.activeElement !== seek || player.playing) seek.value = seconds();
    requestAnimationFrame(show);
  };
  player.play();
  if (asked("t") !== undefined) {
    player.mixer.update(0);
    player.pause();
    go(asked("t"));
  }
  show();
}
