// Curves of one joint over time: torque and position, measured and of each simulation.
const LINES = [["measured", "--ink", []], ["original", "--before", [4, 3]], ["extended", "--after", []]];
const QUANTITIES = ["torque", "position"];

class Curves {
  constructor(content) {
    this.content = content;
    this.lines = LINES.slice(0, 1 + content.simulations);
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
    if (quantity === "torque") return content.measured[at] - (line ? content.residual[line - 1][at] : 0);
    return line ? content.strayed[line - 1][at] : content.position[at];
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
      name.textContent = `${quantity} [${this.unit(quantity)}]`;
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
        const restarted = quantity === "position" && line && frame && window[frame] !== window[frame - 1];
        if (Number.isFinite(value)) context[drawn && !restarted ? "lineTo" : "moveTo"](x, place(value));
        drawn = Number.isFinite(value);
      }
      Object.assign(context, { strokeStyle: style(colour), lineWidth: [1.2, 1.6, 3.2][line] * scale, lineJoin: "round" });
      context.setLineDash(dash.map((length) => length * scale));
      context.stroke();
    }
  }

  report(frame) { // values at a frame
    this.values.forEach((item, line) => {
      item.textContent = QUANTITIES.map((quantity) => {
        const value = this.value(quantity, line, frame);
        return Number.isFinite(value) ? `${value.toPrecision(3).replace("-", "\u2212")} ${this.unit(quantity)}` : "\u2013";
      }).join(", ");
    });
  }
}
