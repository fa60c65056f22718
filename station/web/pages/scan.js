// A scanner types faster than anybody, and ends with Enter or Tab. It is taken wherever the focus is.
(() => {
  const FASTEST_MS = 60, LEAST = 4;
  let text = "", last = 0, slow = false;
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey && event.key !== "]" || event.altKey || event.metaKey) return;
    const now = performance.now();
    if (now - last > 400) { text = ""; slow = false; }
    else if (now - last > FASTEST_MS) slow = true;
    last = now;
    if (event.key === "Enter" || event.key === "Tab") {
      if (text.length >= LEAST && !slow) {
        event.preventDefault();
        event.stopPropagation();
        if (document.activeElement && document.activeElement.blur) document.activeElement.blur();
        emitEvent("scan", { text: text, caps: event.getModifierState("CapsLock") });
      }
      text = ""; slow = false;
    } else if (event.key.length === 1) {
      text += event.ctrlKey ? "\u001d" : event.key;
    }
  }, true);
})();
