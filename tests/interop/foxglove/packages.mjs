// npm's packages in a page without a bundler: just enough of Node's `require` for the few that are used here.
const FILES = {
  "@foxglove/ws-protocol": "@foxglove/ws-protocol/dist/cjs/src/index.js",
  debug: "debug/src/browser.js",
  eventemitter3: "eventemitter3/index.js",
  ms: "ms/index.js",
  protobufjs: "protobufjs/dist/protobuf.js",
  "protobufjs/ext/descriptor": "protobufjs/ext/descriptor/index.js",
  tslib: "tslib/tslib.js",
};
const loaded = new Map();

/** The package, or a file of one, that is called so in `require`. */
export function load(name) {
  const file = FILES[name] ?? (/\.js(on)?$/.test(name) ? name : `${name}.js`);
  if (!loaded.has(file)) {
    const module = { exports: {} };
    loaded.set(file, module);
    run(module, file);
  }
  return loaded.get(file).exports;
}

function run(module, file) {
  const request = new XMLHttpRequest();
  request.open("GET", `node_modules/${file}`, false);
  request.send();
  if (request.status !== 200) {
    throw new Error(`${file}: HTTP ${request.status}`);
  }
  if (file.endsWith(".json")) {
    module.exports = JSON.parse(request.responseText);
    return;
  }
  const near = (name) => load(name.startsWith(".") ? joined(file, name) : name);
  new Function("require", "module", "exports", request.responseText)(near, module, module.exports);
}

function joined(file, relative) {
  const path = new URL(relative, `file:///${file}`).pathname.slice(1);
  const folder = path.replace(/\/$/, "");
  return folder === path || folder in FILES ? folder : `${path}index.js`;
}
