// Curves of one joint over time: torque (of position drives: error against the command) and position, measured and of
// each simulation.
const LINES = [["measured", "--ink", []], ["original", "--before", [4, 3]], ["extended", "--after", []]];
const QUANTITIES = ["torque", "position"];

class Curves {
  constructor(content) {
    this.content = content;
    this.lines = LINES.slice(0, 1 + content.simulations);
    if (content.command && content.simulations === 1) this.lines[1] = ["simulated", "--ghost", []];
    this.command = content.command ? this.lines.push(["command", "--command", [2, 3]]) - 1 : -1; // line of the command
    const n = content.joints.length, loud = content.joints.map(({ torque }, j) => {
      let sum = 0;
      for (let at = j; at < content.residual[0].length; at += n) sum += content.residual[0][at] ** 2 || 0;
      return sum / (torque ** 2) || 0;
    });
    this.joint = loud.indexOf(Math.max(...loud));
    $("joint").append(...content.joints.map(({ name }, j) => new Option(name, j)));
    this.values = this.lines.map(([name, colour, dash]) => {
      const item = document.createElement("li"), mark = document.createElement("i"), value = document.createElement("span");
      Object.assign(mark.style, { borderColor: `var(${colour})`, borderTopStyle: dash.length ? "dotted" : "solid" });
      item.append(mark, document.createTextNode(`${name} `), value);
      $("key").append(item);
      return value;
    });
  }

  value(quantity, line, frame) { // NaN where unknown
    const { content, joint } = this, at = frame * content.joints.length + joint;
    const reached = line === 0 ? content.position[at] : line === this.command ? content.command[at] : content.strayed[line - 1][at];
    if (content.command) return quantity === "position" ? reached : line === this.command ? NaN : content.command[at] - reached;
    if (quantity === "torque") return content.measured[at] - (line ? content.residual[line - 1][at] : 0);
    return reached;
  }

  unit(quantity) {
    const { unit, length } = this.content.joints[this.joint];
    return quantity === "torque" ? unit : length;
  }

  paint() { // all of a joint; the cursor moves over it
    $("joint").value = this.joint;
    for (const quantity of QUANTITIES) {
      const canvas = $(quantity), scale = devicePixelRatio || 1, frames = this.content.frames;
      [canvas.width, canvas.height] = [Math.max(1, Math.round(canvas.clientWidth * scale)), Math.round(canvas.clientHeight * scale)];
      let [low, high] = [Infinity, -Infinity];
      this.lines.forEach((_, line) => {
        for (let frame = 0; frame < frames; frame++) {
          const value = this.value(quantity, line, frame);
          if (value < low) low = value;
          if (value > high) high = value;
        }
      });
      if (!(low <= high)) [low, high] = [-1, 1];
      if (low === high) [low, high] = [low - 1, high + 1];
      const [top, name, bottom] = $(`${quantity}-axis`).children;
      [top.textContent, bottom.textContent] = [high, low].map((end) => (+end.toPrecision(3)).toString().replace("-", "\u2212"));
      name.textContent = `${this.content.command && quantity === "torque" ? "command \u2212 position" : quantity} [${this.unit(quantity)}]`;
      this.draw(canvas, quantity, low, high, scale);
    }
  }

  draw(canvas, quantity, low, high, scale) {
    const context = canvas.getContext("2d"), { window, frames } = this.content, last = Math.max(1, frames - 1);
    const place = (value) => canvas.height - 2 * scale - (value - low) / (high - low) * (canvas.height - 4 * scale);
    context.clearRect(0, 0, canvas.width, canvas.height);
    if (low < 0 && high > 0) {
      context.fillStyle = style("--line");
      context.fillRect(0, place(0), canvas.width, scale);
    }
    const measuredLast = [...this.lines.keys()].slice(1).concat(0);
    for (const line of measuredLast) {
      const [, colour, dash] = this.lines[line];
      context.beginPath();
      let drawn = false;
      for (let frame = 0; frame < frames; frame++) {
        const value = this.value(quantity, line, frame), x = frame / last * canvas.width;
        const restarted = (quantity === "position" || this.command > 0) && line && line !== this.command && frame && window[frame] !== window[frame - 1];
        if (Number.isFinite(value)) context[drawn && !restarted ? "lineTo" : "moveTo"](x, place(value));
        drawn = Number.isFinite(value);
      }
      Object.assign(context, { strokeStyle: style(colour), lineWidth: (line === this.command ? 1.4 : [1.2, 1.6, 3.2][line]) * scale, lineJoin: "round" });
      context.setLineDash(dash.map((length) => length * scale));
      context.stroke();
    }
  }

  report(frame) { // values at a frame
    this.values.forEach((item, line) => {
      const shown = line === this.command ? ["position"] : QUANTITIES;
      item.textContent = shown.map((quantity) => {
        const value = this.value(quantity, line, frame);
        return Number.isFinite(value) ? `${value.toPrecision(3).replace("-", "\u2212")} ${this.unit(quantity)}` : "\u2013";
      }).join(", ");
    });
  }
}
