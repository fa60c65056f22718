// A scanner types faster than anybody, or begins with the "]" of a symbology identifier; it ends with Enter or Tab.
// It is taken wherever the focus is. A key that gives no character by itself (a dead key of another layout) leaves a
// mark in its place: what is lost must not make another serial number. So does every key while Caps Lock is on.
// A key of a scan presses no button: what has the focus loses it with the first sign, and a blank that may begin or end a
// scan presses a button only when nothing comes behind it.
// What ends with Enter and is no scan, typed into no field, is told as typed: a page says that it was not taken.
(() => {
  const FASTEST_MS = 50, PAUSE_MS = 1000, LEAST = 4, SHORT = /^NOK$/i, BLANK_MS = 80, PREFIX = "]", LOST = "\ufffd", NO_CHARACTER = ["Dead", "Process", "Unidentified"];
  let text = "", first = 0, last = 0, caps = false, pressed = 0;
  const isScan = () => (text.length >= LEAST || SHORT.test(text))
    && (text.startsWith(PREFIX) || (last - first) / (text.length - 1) <= FASTEST_MS);
  const isField = (one) => Boolean(one && one.closest && one.closest("input, textarea, select, [contenteditable]"));
  const isButton = (one) => Boolean(one && one.closest && one.closest("button, [role=button], summary"));
  const isPressed = (one) => isButton(one) || Boolean(one && one.closest && one.closest("a"));
  const leave = () => document.activeElement && document.activeElement.blur && document.activeElement.blur();
  const tell = (scan) => window.emitEvent ? emitEvent("scan", scan) : document.dispatchEvent(new CustomEvent("scan", { detail: scan }));
  document.addEventListener("keydown", (event) => {
    if (event.altKey || event.metaKey || (event.ctrlKey && event.key !== PREFIX)) return;
    const lost = NO_CHARACTER.includes(event.key);
    if (event.key === "Enter" || event.key === "Tab") {
      if (isScan()) {
        event.preventDefault();
        event.stopPropagation();
        leave();
        tell({ text: text, caps: caps });
      } else if (text && event.key === "Enter" && window.emitEvent && !isField(event.target)) {
        emitEvent("typed", text);
      }
      text = "";
    } else if (event.key.length === 1 || lost) {
      const now = event.timeStamp;
      if (!text || now - last > PAUSE_MS) { text = ""; first = now; caps = false; }
      last = now;
      clearTimeout(pressed);
      if (event.key === " " && isButton(event.target)) {
        const button = event.target;
        event.preventDefault();
        event.stopPropagation();
        pressed = setTimeout(() => { text = ""; button.click(); }, BLANK_MS);
      } else if (isPressed(document.activeElement)) {
        leave();
      }
      caps = caps || Boolean(event.getModifierState && event.getModifierState("CapsLock"));
      text += lost ? LOST : event.ctrlKey ? "\u001d" : event.key;
    }
  }, true);
  document.addEventListener("keyup", (event) => {  // a blank has pressed its button above, or belongs to a scan
    if (event.key === " " && isButton(event.target)) event.preventDefault();
  }, true);
})();
