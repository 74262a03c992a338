// Prints the Khronos validator's report on a glTF file as JSON. Run from the folder in which npm ci was run.
const { readFileSync } = require("node:fs");
const { validateBytes } = require("gltf-validator");

validateBytes(new Uint8Array(readFileSync(process.argv[2]))).then((report) => process.stdout.write(JSON.stringify(report)));
