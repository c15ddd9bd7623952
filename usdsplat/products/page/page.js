// The page around the viewer: the capture, its camera, other captures, and cameras in the address.
// `createViewer` is the viewer's function. World of the viewer: y up; files are turned by 180
// degrees about z in it.
{
  const page = JSON.parse(document.getElementById("page").textContent);
  const query = new URL(location.href).searchParams;
  const READABLE = /\.(ply|sog|json)$/i;
  const TURNTABLE = { seconds: 30, keys: 180 };
  const USUAL_FOV = 85; // the viewer's, for captures without a camera [deg]
  let viewer = null;
  let isDropped = false; // whether the viewer shows a file that was dropped
  let asked = 0;

  function say(text) {
    const message = document.getElementById("message");
    message.textContent = text;
    message.hidden = !text;
  }

  // --- captures -----------------------------------------------------------------------------

  function bytesOf(text) {
    if (Uint8Array.fromBase64) return Uint8Array.fromBase64(text);
    const binary = atob(text);
    const bytes = new Uint8Array(binary.length);
    for (let i = 0; i < bytes.length; i++) bytes[i] = binary.charCodeAt(i);
    return bytes;
  }

  // The capture in the page; its text is removed, so that it is not in memory twice.
  function embedded() {
    const parts = [...document.querySelectorAll("script.capture")].map((element) => {
      const bytes = bytesOf(element.textContent);
      element.remove();
      return bytes;
    });
    return { name: page.capture, blob: new Blob(parts) };
  }

  // Where the viewer finds a capture: its name, whose suffix is that of a format, and its content.
  function sourceOf({ name, url, blob }) {
    if (!blob) return { contentUrl: url, contentFilename: name };
    return { contentUrl: name, contentFilename: name, contents: Promise.resolve(new Response(blob)) };
  }

  function fromAddress(address) {
    const url = new URL(address, location.href);
    return { name: url.pathname.split("/").pop(), url: url.href };
  }

  // --- cameras ------------------------------------------------------------------------------

  const plus = (a, b, scale = 1) => a.map((x, i) => x + scale * b[i]);
  const dot = (a, b) => a.reduce((sum, x, i) => sum + x * b[i], 0);
  const unit = (a) => a.map((x) => x / Math.hypot(...a));
  const turned = ([x, y, z]) => [-x, -y, z]; // between a file and the viewer

  // The pose of the address, #[16 numbers]: the view matrix by columns from the file to a camera
  // with x right, y down, z forward, as in antimatter15's viewer. Without a valid one, null.
  function poseInAddress(distance, fov) {
    let view;
    try {
      view = JSON.parse(decodeURIComponent(location.hash.slice(1)));
    } catch {
      return null;
    }
    if (!Array.isArray(view) || view.length !== 16 || !view.every(Number.isFinite)) return null;
    const [right, down, forward] = [0, 1, 2].map((row) => unit([view[row], view[4 + row], view[8 + row]]));
    const at = [right, down, forward].reduce((sum, axis, row) => plus(sum, axis, -view[12 + row]), [0, 0, 0]);
    if (![...right, ...down, ...forward, ...at].every(Number.isFinite)) return null;
    const position = turned(at);
    const up = turned(down).map((x) => -x);
    return { position, target: plus(position, turned(forward), distance), up, fov };
  }

  function addressOfPose(camera) {
    const at = turned([...camera.getPosition().toArray()]);
    const [right, up, back] = [camera.right, camera.up, camera.forward].map((v) => turned(v.toArray()));
    const rows = [right, up.map((x) => -x), back];
    const view = [0, 1, 2].flatMap((column) => [...rows.map((row) => row[column]), 0]);
    view.push(...rows.map((row) => -dot(row, at)), 1);
    return `#[${view.map((x) => Number(x.toPrecision(6)))}]`;
  }

  // The longer side of a window in which all of the picture is visible, over that of the picture.
  function longer() {
    const window = innerWidth / innerHeight;
    const [width, height] = page.aspect > 1 ? [1, 1 / page.aspect] : [page.aspect, 1];
    return window > 1 ? Math.max(width, height * window) : Math.max(height, width / window);
  }

  // A field of view with the tangent of its half multiplied [deg].
  const widened = (fov, factor) => (Math.atan(factor * Math.tan((fov * Math.PI) / 360)) * 360) / Math.PI;

  // A field of view of the longer side of the picture, as one of the longer side of the window [deg].
  const fitted = (fov) => widened(fov, longer());

  // A camera that goes once around its target and begins at its pose.
  function turntable({ position, target, up, fov }) {
    const { seconds, keys } = TURNTABLE;
    const around = (v, angle) => {
      const [c, s] = [Math.cos(angle), Math.sin(angle)];
      return [c * v[0] + s * v[2], v[1], c * v[2] - s * v[0]];
    };
    const arm = plus(position, target, -1);
    const angles = [...Array(keys).keys()].map((i) => (-2 * Math.PI * i) / keys);
    const values = {
      position: angles.flatMap((angle) => plus(target, around(arm, angle))),
      target: angles.flatMap(() => target),
      fov: angles.map(() => fov),
    };
    const keyframes = { times: [...angles.keys()], values };
    const shape = { loopMode: "repeat", interpolation: "spline", smoothness: 1 };
    const track = { name: "turntable", duration: seconds, frameRate: keys / seconds, ...shape, keyframes };
    return { track, ups: angles.flatMap((angle) => around(up, angle)) };
  }

  // The camera's settings and up vectors: that of the address, else the stage's with its animation.
  function shotOf() {
    const { settings } = page;
    const initial = { ...settings.cameras[0].initial, fov: fitted(settings.cameras[0].initial.fov) };
    const distance = Math.hypot(...plus(initial.position, initial.target, -1));
    const pose = poseInAddress(distance, initial.fov);
    const [track] = settings.animTracks;
    if (track && !pose) {
      track.keyframes.values.fov = track.keyframes.values.fov.map(fitted);
      return { settings: { ...settings, cameras: [{ initial }] }, ups: page.ups, isStill: false };
    }
    return stillShot(pose ?? { ...initial, up: page.ups });
  }

  // A camera that stands still until it is played, which turns it around its target.
  function stillShot({ up, ...camera }) {
    const { track, ups } = turntable({ ...camera, up });
    const still = { cameras: [{ initial: camera }], animTracks: [track], startMode: "animTrack" };
    return { settings: { ...page.settings, ...still }, ups, isStill: true };
  }

  // Other captures have no camera but that of the address: the viewer shows all of them.
  function shotOfOther(pose = null) {
    if (pose) return stillShot(pose);
    const settings = { ...page.settings, cameras: [], animTracks: [], startMode: "default" };
    return { settings, ups: null, isStill: false };
  }

  // The camera of the address for a capture of unknown size: its target is the point of its axis that
  // is nearest to the origin of the file.
  function poseOfOther() {
    const { position, target } = poseInAddress(1, USUAL_FOV) ?? {};
    if (!position) return null;
    const ahead = -dot(position, plus(target, position, -1));
    return poseInAddress(ahead > 0 ? ahead : Math.hypot(...position) || 1, USUAL_FOV);
  }

  // Windows change their shape, and phones turn. The fields of view of the settings are those of the
  // window at the beginning.
  function refit(shown) {
    const camera = shown.app.root.findByName("camera").camera;
    const before = longer();
    shown.app.on("update", () => {
      if (shown.state.loaded && !shown.app.xr?.active) camera.fov = widened(camera.fov, longer() / before);
    });
  }

  // The viewer keeps the horizon level. Roll the animated camera as the stage's is.
  function roll(shown, { settings, ups }) {
    const camera = shown.app.root.findByName("camera");
    const { frameRate, keyframes } = settings.animTracks[0];
    const { times } = keyframes;
    shown.app.on("update", () => {
      if (shown.state.cameraMode !== "anim" || shown.app.xr?.active) return;
      const at = shown.state.animationTime * frameRate;
      const before = Math.max(0, times.findLastIndex((time) => time <= at));
      const next = (before + 1) % times.length;
      const step = times[next] > times[before] ? times[next] - times[before] : 1;
      const [a, b] = [before, next].map((k) => ups.slice(3 * k, 3 * k + 3));
      const up = plus(a, plus(b, a, -1), Math.min(1, (at - times[before]) / step));
      const angle = Math.atan2(-dot(up, camera.right.toArray()), dot(up, camera.up.toArray()));
      if (Math.abs(angle) > 1e-5) camera.rotateLocal(0, 0, (angle * 180) / Math.PI);
    });
  }

  // --- the viewer ---------------------------------------------------------------------------

  async function show(capture, shot, { isOwn = false, wasDropped = false } = {}) {
    say("");
    if (!READABLE.test(capture.name)) {
      say(`${capture.name}: expected .ply, .compressed.ply, .sog or lod-meta.json`);
      return;
    }
    viewer?.destroy();
    viewer = null;
    isDropped = wasDropped;
    const mine = ++asked;
    const budget = Number(query.get("budget"));
    const shown = await createViewer({
      container: document.body,
      settings: shot.settings,
      ...sourceOf(capture),
      ui: !query.has("noui"),
      noanim: shot.isStill || query.has("noanim"),
      renderer: query.has("webgpu") ? "webgpu" : "webgl", // our pictures are compared with WebGL's
      aa: query.has("aa") || page.antialiased,
      budget: budget > 0 ? budget : undefined,
      lang: query.get("lang"),
    });
    if (mine !== asked) {
      shown.destroy(); // another capture was asked for in the meantime
      return;
    }
    shown.app.assets.on("error", () => say(`${capture.name}: the viewer cannot read it`));
    if (shot.ups) roll(shown, shot);
    if (isOwn) refit(shown);
    viewer = shown;
    globalThis.viewer = shown; // for scripts, with the viewer's own interface
  }

  const failed = (error) => say(`the viewer does not start: ${error?.message ?? error}`);

  async function begin() {
    if (!createViewer) {
      say("The files beside this page cannot be read. Browsers read them from a web host, not from a disk.");
      return;
    }
    const address = query.get("url");
    if (address) {
      await show(fromAddress(address), shotOfOther(poseOfOther()));
      return;
    }
    const own = page.url ? { name: page.capture, url: new URL(page.url, location.href).href } : embedded();
    await show(own, shotOf(), { isOwn: true });
  }

  addEventListener("dragover", (event) => {
    event.preventDefault();
    document.body.classList.add("dropping");
  });
  addEventListener("dragleave", (event) => {
    if (!event.relatedTarget) document.body.classList.remove("dropping");
  });
  addEventListener("drop", (event) => {
    event.preventDefault();
    document.body.classList.remove("dropping");
    const [file] = event.dataTransfer.files;
    if (file) show({ name: file.name, blob: file }, shotOfOther(), { wasDropped: true }).catch(failed);
  });
  addEventListener("hashchange", () => location.reload());
  addEventListener("keydown", (event) => {
    if (event.key !== "v" || event.ctrlKey || event.altKey || event.metaKey || !viewer) return;
    if (isDropped) {
      say("A file that was dropped is not in the page: an address cannot show it to others.");
      return;
    }
    history.replaceState(null, "", addressOfPose(viewer.app.root.findByName("camera")));
  });
  begin().catch(failed);
}
