// Run by node: PlayCanvas draws splats in Chromium on the processor (SwiftShader), until input ends.
//
//   {"do": "open", "modules": PATH, "browser": PATH, "ply": PATH, "view": 4x4, "k": 3x3,
//    "size": [w, h]}              -> {"version": "2.23.3"}
//   {"do": "draw"}                -> {"ms": 1946.0}, until the last pixel is drawn
//   {"do": "save", "path": PATH}  -> {}, the last picture as PNG
//
// `view` takes the world to a camera of OpenCV; `k` are its intrinsics [pixel], with square pixels
// and the axis in the middle. The camera stands still, so the worker's sort is not in the time.

import { readFileSync, writeFileSync } from "node:fs";
import { createRequire } from "node:module";
import { createInterface } from "node:readline";

const ORIGIN = "http://localhost/"; // answered here, by `route`; nothing is listening

async function open({ modules, browser, ply, view, k, size }) {
  const load = createRequire(`${modules}/`);
  const { chromium } = load("playwright-core");
  const engine = readFileSync(`${modules}/playcanvas/build/playcanvas.mjs`);
  const window = await chromium.launch({
    executablePath: browser,
    args: ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"],
  });
  const page = await window.newPage({ viewport: { width: size[0], height: size[1] } });
  await page.route(`${ORIGIN}**`, (route) => {
    const name = new URL(route.request().url()).pathname;
    if (name === "/engine.mjs") return route.fulfill({ contentType: "text/javascript", body: engine });
    if (name === "/splats.ply") return route.fulfill({ body: readFileSync(ply) });
    return route.fulfill({ contentType: "text/html", body: "<canvas></canvas>" });
  });
  await page.goto(ORIGIN);
  const version = await page.evaluate(start, { view, k, size });
  return { window, page, version };
}

// In the page: everything up to the first sorted picture.
async function start({ view, k, size }) {
  const pc = await import("/engine.mjs");
  const canvas = document.querySelector("canvas");
  const options = { antialias: false, alpha: false, preserveDrawingBuffer: true };
  const app = new pc.Application(canvas, { graphicsDeviceOptions: options });
  app.setCanvasFillMode(pc.FILLMODE_NONE, ...size);
  app.setCanvasResolution(pc.RESOLUTION_FIXED, ...size);
  const camera = new pc.Entity();
  camera.addComponent("camera", {
    clearColor: new pc.Color(0, 0, 0, 1),
    fov: (2 * Math.atan(size[1] / 2 / k[1][1]) * 180) / Math.PI,
    nearClip: 0.01,
    farClip: 1000,
  });
  // Its camera looks down -z with y up; matrices are given by columns.
  const turned = [view[0], view[1].map((x) => -x), view[2].map((x) => -x), view[3]];
  const columns = [0, 1, 2, 3].flatMap((c) => turned.map((row) => row[c]));
  const toWorld = new pc.Mat4().set(columns).invert();
  camera.setPosition(toWorld.getTranslation());
  camera.setRotation(new pc.Quat().setFromMat4(toWorld));
  app.root.addChild(camera);
  app.start();
  const asset = new pc.Asset("splats", "gsplat", { url: "/splats.ply" });
  app.assets.add(asset);
  await new Promise((done, failed) => {
    asset.once("load", done);
    asset.once("error", failed);
    app.assets.load(asset);
  });
  const splats = new pc.Entity();
  splats.addComponent("gsplat", { asset });
  app.root.addChild(splats);
  await new Promise((done) => {
    app.systems.gsplat.on("frame:ready", (_camera, _layer, isSorted, loading) => {
      if (isSorted && !loading) done();
    });
  });
  app.autoRender = false;
  const gl = app.graphicsDevice.gl;
  globalThis.draw = () => {
    const before = performance.now();
    app.render();
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4)); // waits for the end
    return performance.now() - before;
  };
  globalThis.png = () => canvas.toDataURL("image/png").split(",")[1];
  return pc.version;
}

let opened;
for await (const line of createInterface({ input: process.stdin })) {
  const { do: what, ...request } = JSON.parse(line);
  let answer = {};
  try {
    if (what === "open") {
      opened = await open(request);
      answer = { version: opened.version };
    } else if (what === "draw") {
      answer = { ms: await opened.page.evaluate(() => globalThis.draw()) };
    } else {
      const png = await opened.page.evaluate(() => globalThis.png());
      writeFileSync(request.path, Buffer.from(png, "base64"));
    }
  } catch (error) {
    answer = { error: String(error) };
  }
  console.log(JSON.stringify(answer));
}
await opened?.window.close();
