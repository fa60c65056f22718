// A scanner types faster than anybody, or begins with the "]" of a symbology identifier; it ends with Enter or Tab.
// It is taken wherever the focus is. A key that gives no character by itself (a dead key of another layout) leaves a
// mark in its place: what is lost must not make another serial number. So does every key while Caps Lock is on.
// What ends with Enter and is no scan, typed into no field, is told as typed: a page says that it was not taken.
(() => {
  const FASTEST_MS = 50, PAUSE_MS = 1000, LEAST = 4, SHORT = /^NOK$/i, PREFIX = "]", LOST = "\ufffd", NO_CHARACTER = ["Dead", "Process", "Unidentified"];
  let text = "", first = 0, last = 0, caps = false;
  const isScan = () => (text.length >= LEAST || SHORT.test(text))
    && (text.startsWith(PREFIX) || (last - first) / (text.length - 1) <= FASTEST_MS);
  const isField = (one) => Boolean(one && one.closest && one.closest("input, textarea, select, [contenteditable]"));
  const tell = (scan) => window.emitEvent ? emitEvent("scan", scan) : document.dispatchEvent(new CustomEvent("scan", { detail: scan }));
  document.addEventListener("keydown", (event) => {
    if (event.altKey || event.metaKey || (event.ctrlKey && event.key !== PREFIX)) return;
    const lost = NO_CHARACTER.includes(event.key);
    if (event.key === "Enter" || event.key === "Tab") {
      if (isScan()) {
        event.preventDefault();
        event.stopPropagation();
        if (document.activeElement && document.activeElement.blur) document.activeElement.blur();
        tell({ text: text, caps: caps });
      } else if (text && event.key === "Enter" && window.emitEvent && !isField(event.target)) {
        emitEvent("typed", text);
      }
      text = "";
    } else if (event.key.length === 1 || lost) {
      const now = event.timeStamp;
      if (!text || now - last > PAUSE_MS) { text = ""; first = now; caps = false; }
      last = now;
      caps = caps || Boolean(event.getModifierState && event.getModifierState("CapsLock"));
      text += lost ? LOST : event.ctrlKey ? "\u001d" : event.key;
    }
  }, true);
})();
