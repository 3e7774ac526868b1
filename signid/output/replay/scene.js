// Scene: the bodies of the robots and the findings of the diagnosis. The world's z axis points up, as in the description.
const THREE = MeshCat.THREE;
const CREASE = Math.cos(35 * Math.PI / 180); // edges sharper than this stay sharp
const VIEW = { azimuth: -0.85, rise: 0.42, angle: 34 };
const style = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

function readContent() { // content of the page, with arrays of the blob in place of their descriptions
  const content = JSON.parse(document.getElementById("content").textContent);
  const text = atob(document.getElementById("blob").textContent), bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  const kinds = { f4: Float32Array, u4: Uint32Array, i2: Int16Array };
  const read = ({ at, count, kind }) => new kinds[kind](bytes.buffer, at, count);
  for (const body of content.bodies) if (body.faces) [body.vertices, body.faces] = [read(body.vertices), read(body.faces)];
  content.recorded = read(content.recorded);
  content.window = read(content.window);
  const points = [...read(content.outline)], along = (k) => points.filter((_, i) => i % 3 === k);
  content.outline = points.flatMap((x, i) => i % 3 ? [] : [new THREE.Vector3(x, points[i + 1], points[i + 2])]);
  content.bounds = [Math.min, Math.max].map((end) => [0, 1, 2].map((k) => end(...along(k))));
  content.simulated = content.simulated.map(read);
  for (const key of ["commanded", "command"]) if (content[key]) content[key] = read(content[key]);
  [content.measured, content.position] = [read(content.measured), read(content.position)];
  [content.residual, content.strayed] = [content.residual.map(read), content.strayed.map(read)];
  content.apart = content.apart.map(read);
  return content;
}

function solid(vertices, faces) { // separate vertices per triangle, smooth across blunt edges only
  const count = faces.length / 3, normal = new Float32Array(3 * count), around = new Map();
  const [a, b, c] = [new THREE.Vector3(), new THREE.Vector3(), new THREE.Vector3()];
  for (let f = 0; f < count; f++) {
    [a, b, c].forEach((p, i) => p.fromArray(vertices, 3 * faces[3 * f + i]));
    b.sub(a).cross(c.sub(a)).toArray(normal, 3 * f); // length: twice the area
    for (let i = 0; i < 3; i++) {
      const corner = faces[3 * f + i];
      if (around.has(corner)) around.get(corner).push(f); else around.set(corner, [f]);
    }
  }
  const size = normal.map((_, i) => i % 3 ? 0 : Math.hypot(normal[i], normal[i + 1], normal[i + 2]));
  const points = new Float32Array(9 * count), normals = new Float32Array(9 * count);
  for (let f = 0; f < count; f++) for (let i = 0; i < 3; i++) {
    const at = 9 * f + 3 * i, corner = faces[3 * f + i];
    for (let k = 0; k < 3; k++) points[at + k] = vertices[3 * corner + k];
    for (const g of around.get(corner)) {
      const dot = normal[3 * f] * normal[3 * g] + normal[3 * f + 1] * normal[3 * g + 1] + normal[3 * f + 2] * normal[3 * g + 2];
      if (g === f || dot >= CREASE * size[3 * f] * size[3 * g]) for (let k = 0; k < 3; k++) normals[at + k] += normal[3 * g + k];
    }
    const length = Math.hypot(normals[at], normals[at + 1], normals[at + 2]) || 1;
    for (let k = 0; k < 3; k++) normals[at + k] /= length;
  }
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(points, 3));
  geometry.setAttribute("normal", new THREE.BufferAttribute(normals, 3));
  return geometry;
}

class Stage {
  constructor(content) {
    this.content = content;
    this.viewer = new MeshCat.Viewer(document.getElementById("view"));
    this.geometries = content.bodies.map((body) => body.faces ? solid(body.vertices, body.faces) : null);
    this.recorded = this.robot("recorded");
    this.simulated = this.robot("simulated", "--ghost");
    this.commanded = content.commanded ? this.robot("commanded", "--command") : [];
    this.marks = content.marks.map((mark, k) => this.mark(mark, k));
    this.surround();
    this.place(false);
  }

  add(path, object) {
    this.viewer.set_object(path, object);
    return object;
  }

  group(path) {
    return this.viewer.scene_tree.find(path).object;
  }

  robot(name, ghost) { // a group per body, named in meshcat's tree, so that other programs can move or hide it
    return this.content.bodies.map((body, k) => {
      const path = ["signid", name, body.name in {} || body.name === "<object>" ? `${body.name} (body)` : body.name];
      const group = this.group(path); // Meshcat's tree cannot hold names such as "constructor"
      if (this.geometries[k]) {
        const material = ghost
          ? new THREE.MeshPhongMaterial({ color: style(ghost), transparent: true, opacity: ghost === "--ghost" ? 0.42 : 0.28, shininess: 10,
            polygonOffset: true, polygonOffsetFactor: 2, polygonOffsetUnits: 2 })
          : new THREE.MeshPhongMaterial({ color: 0x59636e, shininess: 25, specular: 0x222222 });
        const mesh = this.add([...path, "<object>"], new THREE.Mesh(this.geometries[k], material));
        mesh.castShadow = !ghost;
        mesh.receiveShadow = !ghost;
        mesh.renderOrder = ghost ? 1 : 0;
        group.userData.material = material;
      }
      return group;
    });
  }

  mark(mark, k) { // a ring, ball or arrow in the frame of a body of the recorded robot
    const group = this.group(["signid", "marks", `${k} ${mark.title}`]), reach = this.content.reach;
    const material = new THREE.MeshPhongMaterial({ color: style("--mark"), shininess: 60, emissive: style("--mark"),
      emissiveIntensity: 0.2 });
    const along = new THREE.Vector3(...mark.along), point = new THREE.Vector3(...mark.point);
    const put = (mesh) => { mesh.castShadow = true; group.add(mesh); return mesh; };
    const turned = (mesh, from, to) => mesh.quaternion.setFromUnitVectors(from, to.clone().normalize());
    const [Y, Z] = [new THREE.Vector3(0, 1, 0), new THREE.Vector3(0, 0, 1)];
    let anchor = point.clone();
    if (mark.kind === "joint") {
      const radius = this.girth(mark, along), ring = put(new THREE.Mesh(new THREE.TorusGeometry(radius, 0.009 * reach, 16, 72), material));
      turned(ring, Z, along);
    } else if (mark.kind === "body") {
      put(new THREE.Mesh(new THREE.SphereGeometry(Math.max(mark.size, 0.02 * reach), 32, 20), material)).position.copy(point);
    } else if (mark.kind === "force" || mark.kind === "tilt") {
      const up = new THREE.Vector3(-along.y, along.x, 0); // direction of the tilt
      const way = mark.kind === "force" ? along.clone().normalize() : up.multiplyScalar(4).add(Z).normalize();
      const length = (mark.kind === "force" ? 0.28 : 0.4) * reach, thick = 0.014 * reach;
      const shaft = put(new THREE.Mesh(new THREE.CylinderGeometry(thick, thick, 0.75 * length, 20), material));
      const head = put(new THREE.Mesh(new THREE.ConeGeometry(2.6 * thick, 0.25 * length, 28), material));
      const tail = mark.kind === "force" ? -length : 0; // a force ends at its point
      shaft.position.copy(way).multiplyScalar(tail + 0.375 * length);
      head.position.copy(way).multiplyScalar(tail + 0.875 * length);
      turned(shaft, Y, way);
      turned(head, Y, way);
      group.userData.world = mark.kind === "force"; // it keeps its direction while its point moves
      anchor = way.multiplyScalar(tail + 0.4 * length);
    } else {
      anchor.z = 0.06 * reach;
    }
    return { mark, group, anchor, part: this.content.bodies.findIndex((body) => body.body === mark.body), point };
  }

  girth(mark, along) { // radius of a ring around the link at the joint
    const body = this.content.bodies.find((one) => one.body === mark.body), near = [], reach = this.content.reach;
    for (let i = 0; body.vertices && i < body.vertices.length; i += 3) {
      const p = new THREE.Vector3().fromArray(body.vertices, i), height = p.dot(along);
      if (Math.abs(height) < 0.06 * reach) near.push(Math.sqrt(Math.max(0, p.lengthSq() - height ** 2)));
    }
    near.sort((x, y) => x - y);
    const most = near.length ? near[Math.floor(0.5 * (near.length - 1))] : 0;
    return Math.min(0.105, Math.max(0.06, 1.35 * most / reach)) * reach;
  }

  surround() { // light, ground and colours instead of Meshcat's own
    const [low, high] = this.content.bounds, viewer = this.viewer;
    const size = Math.hypot(...high.map((x, i) => x - low[i])), ground = Math.min(0, low[2]) - 1e-3 * size;
    for (const path of [["Lights"], ["Grid"], ["Axes"]]) viewer.delete_path(path);
    const paint = (key, name) => viewer.set_property(["Background"], key, new THREE.Color(style(name)).toArray());
    paint("top_color", "--ground");
    paint("bottom_color", "--ground");
    viewer.show_background();
    const dark = matchMedia("(prefers-color-scheme: dark)").matches;
    this.add(["Lights", "sky", "<object>"], new THREE.HemisphereLight(0xffffff, dark ? 0x39424b : 0x9aa3ab, 0.62));
    viewer.scene_tree.find(["Lights", "sky", "<object>"]).object.position.set(0, 0, 1);
    const sun = this.add(["Lights", "sun", "<object>"], new THREE.DirectionalLight(0xffffff, 0.55));
    const centre = low.map((x, i) => (x + high[i]) / 2);
    sun.position.set(centre[0] + 0.5 * size, centre[1] - 0.7 * size, centre[2] + 1.4 * size);
    sun.target = this.group(["Lights", "aim"]);
    sun.target.position.set(...centre);
    sun.castShadow = true;
    sun.shadow.mapSize.set(2048, 2048);
    Object.assign(sun.shadow.camera, { left: -size, right: size, top: size, bottom: -size, near: 0.1 * size, far: 4 * size });
    sun.shadow.bias = -2e-3;
    sun.shadow.radius = 4;
    const fill = this.add(["Lights", "fill", "<object>"], new THREE.DirectionalLight(0xffffff, 0.22));
    fill.position.set(-1, -0.4, 0.5);
    const power = 10 ** Math.floor(Math.log10(size / 8)), step = [5, 2, 1].find((k) => k * power <= size / 8) * power;
    const wide = 20 * step; // no line passes behind the camera
    this.grid = +step.toPrecision(1);
    const grid = this.add(["Grid", "<object>"], new THREE.GridHelper(wide, 20, style("--line"), style("--line")));
    grid.rotation.x = Math.PI / 2;
    grid.material.transparent = true;
    grid.material.opacity = dark ? 0.7 : 0.9;
    grid.position.z = ground;
    const shadow = this.add(["Ground", "<object>"], new THREE.Mesh(new THREE.PlaneGeometry(2 * wide, 2 * wide), new THREE.ShadowMaterial({ opacity: 0.16 })));
    shadow.position.z = ground - 1e-3 * size;
    shadow.receiveShadow = true;
    shadow.material.depthWrite = false;
    [shadow.renderOrder, grid.renderOrder] = [-2, -1];
  }

  place(beside) { // both robots at one place, or the simulated one to the right
    const side = new THREE.Vector3(-Math.sin(VIEW.azimuth), Math.cos(VIEW.azimuth), 0);
    const across = this.content.outline.map((point) => point.dot(side)), width = Math.max(...across) - Math.min(...across);
    this.shift = beside ? side.multiplyScalar(1.08 * width) : new THREE.Vector3();
    this.group(["signid", "simulated"]).position.copy(this.shift);
    for (const { userData, children } of this.simulated) if (userData.material) {
      userData.material.opacity = beside ? 0.75 : 0.42;
      children.forEach((mesh) => { mesh.castShadow = beside; });
    }
    this.viewer.set_dirty();
  }

  look() { // view of everything, clear of the panels above and below
    const [low, high] = this.content.bounds, { viewer, shift } = this, { camera } = viewer;
    const target = new THREE.Vector3(...low).add(new THREE.Vector3(...high)).add(shift).multiplyScalar(0.5);
    const way = new THREE.Vector3(Math.cos(VIEW.azimuth), Math.sin(VIEW.azimuth), VIEW.rise).normalize();
    const right = new THREE.Vector3(-Math.sin(VIEW.azimuth), Math.cos(VIEW.azimuth), 0), up = way.clone().cross(right);
    const [story, switches] = ["story", "switches"].map((id) => document.getElementById(id)), labels = [...document.querySelectorAll(".label")];
    const bar = document.querySelector("footer").offsetHeight + 12, narrow = innerWidth < 760, height = innerHeight, beside = shift.length() > 0;
    const below = (panel) => panel.offsetTop + panel.offsetHeight + 8, stack = labels.reduce((sum, label) => sum + label.offsetHeight + 8, 0);
    const top = Math.max(below(switches), beside ? below(story) : 0) + (narrow ? Math.min(stack, 0.3 * height, 0.5 * (height - bar - below(switches))) : 0);
    const tall = Math.tan(VIEW.angle * Math.PI / 360), free = Math.max(0.1, (height - bar - top) / height);
    const near = narrow || beside ? 0 : story.offsetWidth + 12;
    const far = narrow ? 0 : Math.max(0, ...labels.map((label) => label.offsetWidth + 12));
    const wide = tall * (innerWidth - near - far) / height;
    let distance = 0;
    for (const point of this.content.outline) for (const moved of [0, 1]) {
      const seen = point.clone().addScaledVector(shift, moved).sub(target), depth = seen.dot(way);
      distance = Math.max(distance, depth + Math.abs(seen.dot(right)) / (0.94 * wide), depth + Math.abs(seen.dot(up)) / (tall * free));
    }
    Object.assign(camera, { fov: VIEW.angle, near: 0.01 * distance, far: 30 * distance });
    target.addScaledVector(up, -distance * tall * (bar - top) / height).addScaledVector(right, distance * tall * (far - near) / height);
    const swap = (p) => [p.x, p.z, -p.y]; // Meshcat's camera has y up
    camera.position.set(...swap(target.clone().addScaledVector(way, distance)));
    viewer.controls.target.set(...swap(target));
    viewer.controls.update();
    viewer.set_dirty();
  }

  pose(groups, poses, frame, share) { // interpolates between two frames; hidden without a pose
    const b = groups.length, from = 7 * b * frame, to = share > 0 ? from + 7 * b : from, turn = new THREE.Quaternion();
    groups.forEach((group, k) => {
      const at = from + 7 * k, next = to + 7 * k;
      group.visible = Number.isFinite(poses[at]);
      group.position.fromArray(poses, at);
      group.quaternion.fromArray(poses, at + 3);
      if (share > 0) {
        group.position.lerp(new THREE.Vector3().fromArray(poses, next), share);
        group.quaternion.slerp(turn.fromArray(poses, next + 3), share);
      }
    });
  }

  poseMarks(t) {
    for (const { mark, group, part, point } of this.marks) {
      const body = this.recorded[part];
      group.visible = !mark.time || (t >= mark.time[0] && t <= mark.time[1]);
      group.position.copy(body.position);
      if (group.userData.world) group.position.add(point.clone().applyQuaternion(body.quaternion));
      else group.quaternion.copy(body.quaternion);
    }
  }

  screen(mark) { // position of a mark [pixels]
    const seen = this.viewer.camera, at = mark.group.localToWorld(mark.anchor.clone()).project(seen);
    return { x: (at.x + 1) / 2 * innerWidth, y: (1 - at.y) / 2 * innerHeight, visible: Math.abs(at.z) < 1 };
  }
}
