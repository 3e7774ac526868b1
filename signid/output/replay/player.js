// Time, switches and texts.
const $ = (id) => document.getElementById(id);
const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4];
const seconds = (t) => t.toFixed(2);

class Player {
  constructor(content) {
    this.content = content;
    this.length = (content.frames - 1) * content.period;
    const first = Math.max(0, content.window.findIndex((window) => window >= 0)); // filters shorten both ends
    this.state = { t: first * content.period, playing: false, speed: 1, model: 0, beside: false, byShare: false };
    this.stage = new Stage(content);
    this.write();
    this.wire();
    this.stage.look();
    this.repaint();
    this.tick = this.tick.bind(this);
    this.last = performance.now();
    requestAnimationFrame(this.tick);
  }

  write() { // static texts
    const { content } = this, causes = content.marks.filter((mark) => mark.cause);
    document.querySelector("h1").textContent = content.title;
    $("verdict").textContent = content.headline;
    $("marked").hidden = !causes.length;
    const often = content.horizon ? `restarted every ${+content.horizon.toPrecision(3)} s` : "";
    document.querySelector("#legend li:nth-child(2) span").textContent = ["simulated", content.command ? "from the commands alone" : "", often].filter(Boolean).join(", ").replace("simulated, from", "simulated from");
    $("commanded").hidden = !content.command;
    const small = content.marks.filter((mark) => !mark.cause).map((mark) => `small correction: ${mark.title}`);
    $("notes").append(Object.assign(document.createElement("li"), { id: "others", hidden: true }), ...[...small, ...content.notes, `grid: ${this.stage.grid} m`].map((note) => Object.assign(document.createElement("li"), { textContent: note })));
    const n = content.joints.length, height = Math.min(176, Math.max(26, 13 * n)), every = Math.ceil(11 * n / height);
    const names = content.joints.map(({ name }) => name), prefix = n < 2 ? "" : names[0].slice(0, names[0].lastIndexOf("_") + 1);
    const narrow = innerWidth < 760 && names.some((name) => name.length > 10) && names.every((name) => name.startsWith(prefix));
    const cut = narrow ? prefix.length : 0; // names differ at their ends
    const tail = names[0].slice(names[0].lastIndexOf("_")), alike = n > 1 && names[0].includes("_") && names.every((name) => name.endsWith(tail));
    const end = innerWidth < 760 && alike && !cut ? tail.length : 0; // or before a common end such as _joint
    $("names").append(...content.joints.map(({ name }, j) => {
      const cause = causes.some((mark) => mark.joints.includes(name));
      const shown = cause || j % every === 0; // of many joints only some are labelled
      return Object.assign(document.createElement("span"), { textContent: shown ? name.slice(cut, name.length - end) : "", title: name, className: cause ? "cause" : "" });
    }));
    this.curves = new Curves(content);
    for (const id of ["names", "map"]) $(id).style.height = `${height}px`;
    $("map").addEventListener("pointermove", (event) => {
      $("map").title = content.joints[this.row(event)].name;
    });
    $("time").max = this.length;
    $("speed").append(...SPEEDS.map((speed) => new Option(`${speed}\u00d7`, speed, speed === 1, speed === 1)));
    this.labels = this.stage.marks.filter(({ mark }) => mark.cause).map((mark) => {
      const label = Object.assign(document.createElement("div"), { className: "label" });
      label.append(Object.assign(document.createElement("b"), { textContent: mark.mark.title }),
        ...mark.mark.lines.flatMap((line) => [Object.assign(document.createElement("span"), { textContent: line }), document.createElement("br")]));
      const [line, dot] = ["line", "circle"].map((tag) => document.createElementNS("http://www.w3.org/2000/svg", tag));
      dot.setAttribute("r", 3.5);
      $("leaders").append(line, dot);
      $("labels").append(label);
      return { mark, label, line, dot };
    });
  }

  choice(id, words, change) {
    $(id).append(...words.map((word, k) => {
      const label = document.createElement("label"), input = document.createElement("input");
      Object.assign(input, { type: "radio", name: id, value: k, checked: k === 0 });
      input.addEventListener("change", () => change(k));
      label.append(input, Object.assign(document.createElement("span"), { textContent: word }));
      return label;
    }));
    $(id).hidden = words.length < 2;
    if (words.length < 2) $(id).style.display = "none";
  }

  wire() {
    const { content, state } = this;
    const models = ["original", "extended"].slice(0, content.simulations);
    this.choice("model", models, (k) => { state.model = k; this.repaint(); });
    this.choice("layout", ["overlaid", "side by side"], (k) => { state.beside = k === 1; document.body.classList.toggle("beside", k === 1); this.fold(k === 1 || innerWidth < 760); this.stage.place(k === 1); this.stage.look(); this.repaint(); });
    this.choice("shown", ["no curves", "curves"], (k) => { $("curves").hidden = k === 0; this.stage.look(); this.repaint(); });
    if (innerHeight >= 720) $("shown").querySelectorAll("input")[1].click();
    $("joint").addEventListener("change", (event) => this.choose(Number(event.target.value)));
    this.choice("colour", content.command ? ["error"] : ["torque", "share of torque"], (k) => { state.byShare = k === 1; this.repaint(); });
    $("play").addEventListener("click", () => this.play(!state.playing));
    $("time").addEventListener("input", (event) => { this.play(false); this.seek(Number(event.target.value)); });
    $("speed").addEventListener("change", (event) => { state.speed = Number(event.target.value); });
    $("fold").addEventListener("click", () => this.fold(!$("more").hidden));
    for (const name of ["recorded", "simulated", "commanded"]) $(`show-${name}`).addEventListener("change", () => this.repaint());
    const scrub = (event) => {
      const box = $("map").getBoundingClientRect();
      this.seek(this.length * (event.clientX - box.left) / box.width);
    };
    $("map").addEventListener("pointerdown", (event) => { this.play(false); this.choose(this.row(event)); $("map").setPointerCapture(event.pointerId); scrub(event); });
    $("map").addEventListener("pointermove", (event) => { if (event.buttons) scrub(event); });
    addEventListener("keydown", (event) => this.key(event));
    addEventListener("resize", () => { this.stage.look(); this.repaint(); });
    addEventListener("hashchange", () => this.follow());
    this.fold(innerWidth < 760);
    this.follow();
  }

  fold(hidden) {
    $("more").hidden = hidden;
    $("fold").setAttribute("aria-expanded", String(!hidden));
  }

  row(event) { // joint of the strip below the pointer
    const box = $("map").getBoundingClientRect(), n = this.content.joints.length;
    return Math.max(0, Math.min(n - 1, Math.floor((event.clientY - box.top) / box.height * n)));
  }

  choose(joint) { // of the curves
    this.curves.joint = joint;
    this.repaint();
  }

  key(event) {
    if (event.target.closest("select, input:not([type=range])") || event.ctrlKey || event.metaKey || event.altKey) return;
    const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (event.key === " " && !event.target.closest("button")) { event.preventDefault(); this.play(!this.state.playing); }
    if (step) { event.preventDefault(); this.play(false); this.seek(this.state.t + step * this.content.period); }
  }

  follow() { // a link to a time: #t=3.2&simulation=1&side=1&share=1&joint=2&curves=1&play=1
    const asked = new URLSearchParams(location.hash.slice(1)), flag = (key) => Number(asked.get(key) === "1");
    for (const [id, key] of [["model", "simulation"], ["layout", "side"], ["colour", "share"], ["shown", "curves"]]) {
      const input = $(id).querySelectorAll("input")[flag(key)];
      if (asked.has(key) && input) input.click();
    }
    if (asked.has("joint")) this.choose(Math.max(0, Math.min(this.content.joints.length, Number(asked.get("joint")) || 1) - 1));
    if (asked.has("t")) this.seek(Number(asked.get("t")) || 0);
    if (asked.has("play")) this.play(flag("play") === 1);
  }

  play(on) {
    if (on && this.state.t >= this.length) this.seek(0);
    this.state.playing = on;
    this.last = performance.now();
    $("play").classList.toggle("on", on);
    $("play").setAttribute("aria-label", on ? "pause" : "play");
  }

  seek(t) {
    this.state.t = Math.max(0, Math.min(this.length, t));
    this.draw();
  }

  tick(now) {
    requestAnimationFrame(this.tick);
    if (this.state.playing) {
      const t = this.state.t + this.state.speed * Math.max(0, now - this.last) / 1000;
      this.seek(t);
      if (t >= this.length) this.play(false);
    }
    this.last = now;
    this.label();
  }

  repaint() { // after a switch
    drawScale($("scale"), this.content, this.state);
    drawStrip($("map").querySelector("canvas"), this.content, this.state);
    if (!$("curves").hidden) this.curves.paint();
    this.stage.group(["signid", "recorded"]).visible = $("show-recorded").checked;
    this.stage.group(["signid", "marks"]).visible = $("show-recorded").checked;
    this.stage.group(["signid", "simulated"]).visible = $("show-simulated").checked;
    if (this.content.command) this.stage.group(["signid", "commanded"]).visible = $("show-commanded").checked;
    this.draw();
  }

  draw() {
    const { content, state, stage } = this, place = state.t / content.period;
    const frame = Math.min(content.frames - 1, Math.floor(place + 1e-9)), share = frame + 1 < content.frames ? Math.max(0, place - frame) : 0;
    stage.pose(stage.recorded, content.recorded, frame, share);
    const same = share > 0 && content.window[frame] === content.window[frame + 1];
    const known = same && Number.isFinite(content.simulated[state.model][7 * content.bodies.length * (frame + 1)]);
    stage.pose(stage.simulated, content.simulated[state.model], frame, known ? share : 0);
    if (content.command) stage.pose(stage.commanded, content.commanded, frame, 0); // held until the next
    stage.poseMarks(content.start + state.t);
    content.bodies.forEach(({ joint }, k) => {
      const { material } = stage.recorded[k].userData;
      if (!material || joint < 0) return;
      const [r, g, b] = residualColour(residualAt(content, state, joint, frame) / colourEnd(content, joint, state.byShare));
      material.color.setRGB(r / 255, g / 255, b / 255);
    });
    stage.viewer.set_dirty();
    $("time").value = state.t;
    for (const cursor of document.querySelectorAll(".cursor")) cursor.style.left = `${100 * state.t / this.length}%`;
    if (!$("curves").hidden) this.curves.report(frame);
    $("clock").textContent = `${seconds(state.t)} s\nof ${seconds(this.length)} s`;
    this.report(frame);
  }

  report(frame) { // largest residual, and distance of the robots
    const { content, state, stage } = this;
    let [most, which] = [-1, -1];
    content.joints.forEach((_, j) => {
      const share = Math.abs(residualAt(content, state, j, frame)) / colourEnd(content, j, state.byShare);
      if (share > most) [most, which] = [share, j];
    });
    const apart = Math.max(...stage.recorded.map((group, k) => group.position.distanceTo(stage.simulated[k].position)));
    const far = stage.simulated[0].visible ? `robots up to ${apart < 0.1 ? `${(1000 * apart).toFixed(0)} mm` : `${apart.toFixed(2)} m`} apart`
      : "no simulation at this time";
    const lines = content.apart[state.model][frame] ? ["the simulation flies apart: some joints are not followed"] : [far];
    if (which >= 0) {
      const { name, unit, torque } = content.joints[which], value = residualAt(content, state, which, frame);
      const shown = state.byShare ? `${(100 * value / torque).toFixed(0)} %` : `${value.toPrecision(3)} ${unit}`;
      lines.push(`largest: ${name}, ${value > 0 ? "+" : ""}${shown}`.replace("-", "\u2212"));
    }
    $("readout").replaceChildren(...lines.flatMap((line, k) => k ? [document.createElement("br"), line] : [line]));
  }

  label() { // in a column on the right, in the order of the marks
    const shown = $("show-recorded").checked;
    let floor = document.querySelector("footer").offsetTop - 8;
    const all = this.labels.map((one) => ({ ...one, at: this.stage.screen(one.mark), h: one.label.offsetHeight }));
    const narrow = innerWidth < 760; // labels then stand above the robot
    let below = 20 + $("switches").offsetTop + $("switches").offsetHeight;
    const ceiling = below, room = narrow ? Math.max(0.5 * (floor - ceiling), all[0]?.h ?? 0) : floor - ceiling;
    const more = $("unlabelled"), whole = all.reduce((sum, one) => sum + one.h + 8, -8), kept = whole > room ? more.offsetHeight + 8 : 0;
    let used = 0; // labels without room are counted, and named in the notes
    const fits = all.map((one, k) => (used += one.h + 8) - 8 <= room - kept || k === 0), spots = all.filter((_, k) => fits[k]);
    for (const { label, line, dot } of all.filter((_, k) => !fits[k])) for (const part of [label, line, dot]) part.style.visibility = "hidden";
    const others = all.filter((_, k) => !fits[k]).map((one) => one.mark.mark.title);
    more.textContent = `and ${others.length} more`;
    more.style.visibility = shown && others.length ? "visible" : "hidden";
    $("others").hidden = !others.length;
    $("others").textContent = `not labelled: ${others.join("; ")}`;
    const foot = floor - more.offsetHeight;
    if (others.length) floor = foot - 8;
    if (!narrow) spots.sort((a, b) => a.at.y - b.at.y);
    for (const spot of spots) {
      spot.y = narrow ? below : Math.max(below, spot.at.y - spot.h / 2);
      below = spot.y + spot.h + 8;
    }
    more.style.transform = `translate(${innerWidth - 12 - more.offsetWidth}px, ${Math.round(narrow ? below : foot)}px)`;
    for (const spot of [...spots].reverse()) {
      spot.y = Math.max(ceiling, Math.min(spot.y, floor - spot.h));
      floor = spot.y - 8;
    }
    for (const { mark, label, line, dot, at, y, h } of spots) {
      const x = innerWidth - 12 - label.offsetWidth, seen = shown && at.visible;
      label.style.transform = `translate(${Math.round(x)}px, ${Math.round(y)}px)`;
      for (const part of [label, line, dot]) part.style.visibility = seen ? "visible" : "hidden";
      label.classList.toggle("gone", !mark.group.visible);
      for (const part of [line, dot]) part.style.opacity = mark.group.visible ? 1 : 0;
      const ends = { x1: at.x, y1: at.y, x2: x, y2: y + h / 2 };
      for (const [key, value] of Object.entries(ends)) line.setAttribute(key, value);
      for (const [key, value] of [["cx", at.x], ["cy", at.y]]) dot.setAttribute(key, value);
    }
  }
}

try {
  window.player = new Player(readContent());
  if (document.body.classList.contains("live")) window.player.stage.viewer.connect();
} catch (error) {
  $("failure").hidden = false;
  $("failure").textContent = `This page needs a browser with WebGL (${error.message}).`;
  throw error;
}
