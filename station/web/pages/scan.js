// A scanner types faster than anybody, or begins with the "]" of a symbology identifier; it ends with Enter or Tab.
// It is taken wherever the focus is.
(() => {
  const FASTEST_MS = 50, PAUSE_MS = 1000, LEAST = 4, PREFIX = "]";
  let text = "", first = 0, last = 0;
  const isScan = () => text.length >= LEAST
    && (text.startsWith(PREFIX) || (last - first) / (text.length - 1) <= FASTEST_MS);
  document.addEventListener("keydown", (event) => {
    if (event.altKey || event.metaKey || (event.ctrlKey && event.key !== PREFIX)) return;
    if (event.key === "Enter" || event.key === "Tab") {
      if (isScan()) {
        event.preventDefault();
        event.stopPropagation();
        if (document.activeElement && document.activeElement.blur) document.activeElement.blur();
        emitEvent("scan", { text: text });
      }
      text = "";
    } else if (event.key.length === 1) {
      const now = event.timeStamp;
      if (!text || now - last > PAUSE_MS) { text = ""; first = now; }
      last = now;
      text += event.ctrlKey ? "\u001d" : event.key;
    }
  }, true);
})();
