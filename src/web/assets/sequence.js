// A sequence's page: turns over its references.

import { viewer } from "./viewer.js";

const { hash } = JSON.parse(document.getElementById("data").textContent);
if (document.getElementById("frame")) viewer(["reference"], (frame) => `/api/v1/sequences/${hash}/frames/${frame}`);
