// Build Spark's tree of a capture, and choose cuts of it, as its web worker does.
//
//   node spark_lod.mjs PACKAGE SOURCE.ply quick|quality FOLDER COUNT...
//
// The worker's script and its WebAssembly are texts within the module of the package, which itself
// needs a browser. FOLDER gets the splats as Spark encodes them, `ext0.u32` and `ext1.u32`, and
// `cut_COUNT.u32` with the rows of the cut of at most COUNT splats that is seen from afar. One line
// of JSON has the seconds and the processor time of reading and building, and numbers of splats.

import fs from "node:fs";
import path from "node:path";
import vm from "node:vm";

const [packageFolder, source, how, folder, ...counts] = process.argv.slice(2);
const script = fs.readFileSync(path.join(packageFolder, "dist", "spark.module.js"), "utf8");

function valueOf(name) {
  const start = script.indexOf(`const ${name} = `) + `const ${name} = `.length;
  return script.slice(start, script.indexOf(";\n", start));
}

const listeners = new Set();
let answered;
globalThis.self = {
  addEventListener: (_, listener) => listeners.add(listener),
  removeEventListener: (_, listener) => listeners.delete(listener),
  postMessage: (message) => message.status || answered(message),
};

function send(data) {
  for (const listener of [...listeners]) listener({ data });
}

function call(name, args) {
  return new Promise((resolve, reject) => {
    answered = ({ result, error }) => (error ? reject(error) : resolve(result));
    send({ id: 0, name, args });
  });
}

function save(name, array) {
  const bytes = Buffer.from(array.buffer, array.byteOffset, array.byteLength);
  fs.writeFileSync(path.join(folder, name), bytes);
}

console.log = console.error;
vm.runInThisContext(vm.runInThisContext(valueOf("jsContent")));
const wasm = Buffer.from(/^decode64\("([^"]*)"\)/.exec(valueOf("WASM"))[1], "base64");
send({ name: "init-wasm", module: await WebAssembly.compile(wasm) });

const fileBytes = new Uint8Array(fs.readFileSync(source));
const wall = performance.now();
const cpu = process.cpuUsage();
const lod = how === "quality" ? "quality" : true;
const { lodSplats } = await call("loadExtSplats", { fileBytes, fileType: "ply", pathName: source, lod });
const spent = process.cpuUsage(cpu);
const seconds = (performance.now() - wall) / 1e3;
const { numSplats, extArrays, extra } = lodSplats;
extArrays.forEach((array, number) => save(`ext${number}.u32`, array));

const { lodId } = await call("initLodTree", { numSplats, lodTree: extra.lodTree.slice() });
const far = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 1e3, 1];
const whole = { lodScale: 1, behindFoveate: 1, coneFov0: 0, coneFov: 0, coneFoveate: 1 };
for (const count of counts) {
  const { keyIndices } = await call("traverseLodTrees", {
    maxSplats: Number(count),
    pixelScaleLimit: 0,
    traverseMode: "standard",
    instances: { only: { instanceId: "only", lodId, viewToObjectCols: far, ...whole } },
  });
  save(`cut_${count}.u32`, keyIndices.only.indices.slice(0, keyIndices.only.numSplats));
}
const used = { seconds, cpu: (spent.user + spent.system) / 1e6 };
process.stdout.write(`${JSON.stringify({ ...used, splats: numSplats })}\n`);
