// Colours of torque residuals: blue below, grey around zero, orange above; safe for colour-blind viewers.
const STOPS = [[-1, 0x0b, 0x3c, 0x78], [-0.5, 0x2b, 0x7b, 0xba], [0, 0xc9, 0xce, 0xd3], [0.5, 0xe0, 0x8a, 0x2c],
  [1, 0x9c, 0x3d, 0x00]];
const UNKNOWN = [0x8d, 0x95, 0x9d];

function residualColour(share) { // share of the scale, clipped
  if (!Number.isFinite(share)) return UNKNOWN;
  const x = Math.max(-1, Math.min(1, share));
  const k = Math.max(1, STOPS.findIndex((stop) => x <= stop[0]));
  const [a, b] = [STOPS[k - 1], STOPS[k]], u = (x - a[0]) / (b[0] - a[0]);
  return [1, 2, 3].map((i) => Math.round(a[i] + u * (b[i] - a[i])));
}

function colourEnd(content, joint, byShare) { // end of the scale for a joint, in its unit
  const { unit, torque } = content.joints[joint];
  return byShare ? content.scale.share * torque : content.scale[unit];
}

function residualAt(content, state, joint, frame) {
  return content.residual[state.model][frame * content.joints.length + joint];
}

function drawStrip(canvas, content, state) { // one row per joint, one column per frame
  const n = content.joints.length, most = 4096, step = Math.ceil(content.frames / most);
  canvas.width = Math.ceil(content.frames / step);
  canvas.height = n;
  const image = new ImageData(canvas.width, n);
  for (let j = 0; j < n; j++) {
    const end = colourEnd(content, j, state.byShare);
    for (let x = 0; x < canvas.width; x++) {
      const residual = residualAt(content, state, j, Math.min(content.frames - 1, x * step));
      image.data.set([...residualColour(residual / end), Number.isFinite(residual) ? 255 : 0], 4 * (j * canvas.width + x));
    }
  }
  canvas.getContext("2d").putImageData(image, 0, 0);
}

function drawScale(figure, content, state) {
  const canvas = figure.querySelector("canvas"), context = canvas.getContext("2d");
  for (let x = 0; x < canvas.width; x++) {
    context.fillStyle = `rgb(${residualColour(2 * x / (canvas.width - 1) - 1)})`;
    context.fillRect(x, 0, 1, 1);
  }
  const units = [...new Set(content.joints.map((joint) => joint.unit))];
  const ends = state.byShare ? [`${+(100 * content.scale.share).toPrecision(3)} %`]
    : units.map((unit) => `${+content.scale[unit].toPrecision(3)} ${unit}`);
  const [low, , high] = figure.querySelectorAll("span");
  low.textContent = ends.map((end) => `\u2212${end}`).join(" or ");
  high.textContent = ends.map((end) => `+${end}`).join(" or ");
  figure.querySelector("figcaption").textContent = content.command ? "position: measured \u2212 simulated" : state.byShare
    ? "torque: measured \u2212 predicted, of the joint\u2019s rms" : "torque: measured \u2212 predicted";
}
