// The key of a jog is held for as long as the pointer is down on it, or Space or Enter on it by the keyboard, while the
// page is shown and has the focus. Whatever ends one of these lets go. The server asks some twenty times a second, and
// only an answer to its last question counts: a page that hangs, or a cut connection, answers nothing.
(() => {
  let held = 0, by = null;
  const here = () => !document.hidden && document.hasFocus();
  const key = (event) => event.target.closest ? event.target.closest("[data-jog]") : null;
  const ask = (action, values) => emitEvent("action", { action: action, values: values });
  const hold = (button, way) => {
    if (held || !here() || button.disabled || button.getAttribute("aria-disabled") === "true") return;
    held = Number(button.dataset.jog);
    by = { button: button, way: way };
    button.classList.add("lm-held");
    ask("hold_jog", { direction: held });
  };
  const release = (why) => {
    if (!held) return;
    by.button.classList.remove("lm-held");
    held = 0;
    by = null;
    if (window.socket && window.socket.connected) ask("release_jog", { why: why });
  };
  window.jogAsked = (question) => {
    if (held && !here()) release(document.hidden ? "hidden" : "blurred");
    if (held && !by.button.isConnected) release("left");
    if (held) emitEvent("jog_token", { question: question, direction: held });
  };
  document.addEventListener("pointerdown", (event) => {
    const button = key(event);
    if (!button || !event.isPrimary || event.button !== 0) return;
    event.preventDefault();
    button.focus();
    if (button.hasPointerCapture && button.hasPointerCapture(event.pointerId)) button.releasePointerCapture(event.pointerId);
    hold(button, "pointer");
  }, true);
  document.addEventListener("pointerup", () => by && by.way === "pointer" && release("released"), true);
  document.addEventListener("pointercancel", () => by && by.way === "pointer" && release("left"), true);
  document.addEventListener("pointerover", (event) => {
    if (by && by.way === "pointer" && key(event) !== by.button) release("left");
  }, true);
  document.addEventListener("contextmenu", (event) => { if (key(event)) event.preventDefault(); }, true);
  document.addEventListener("keydown", (event) => {
    const button = key(event);
    if (!button || (event.key !== " " && event.key !== "Enter")) return;
    event.preventDefault();
    if (!event.repeat) hold(button, event.key);
  }, true);
  document.addEventListener("keyup", (event) => {
    if (by && by.way === event.key) { event.preventDefault(); release("released"); }
  }, true);
  document.addEventListener("focusout", (event) => by && event.target === by.button && release("blurred"), true);
  document.addEventListener("visibilitychange", () => document.hidden && release("hidden"));
  window.addEventListener("blur", () => release("blurred"));
  window.addEventListener("pagehide", () => release("left"));
})();
