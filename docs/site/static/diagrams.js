// Draws the diagrams of a page. Where the browser refuses to load the library, their text stays.
import { mermaid } from "./mermaid/index.js";

const dark = document.body.dataset.theme === "dark" ||
  (document.body.dataset.theme === "auto" && matchMedia("(prefers-color-scheme: dark)").matches);
mermaid.initialize({ startOnLoad: false, theme: dark ? "dark" : "neutral", securityLevel: "strict" });
await mermaid.run();
