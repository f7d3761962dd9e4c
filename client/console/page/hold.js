// Hold to run: said again and again while the button or the space bar is held, so that silence lets it go.

const AGAIN_MS = 40;

export class Hold {
  // `say` tells the console; `may`: whether this page controls; `stays`: where the focus may go while a key holds.
  constructor(button, { say, may, stays }) {
    Object.assign(this, { button, say, may, timer: null, by: null });
    button.addEventListener("pointerdown", (event) => {
      // One finger holds while another draws: whichever of them came first.
      if (event.button !== 0) return;
      button.setPointerCapture(event.pointerId);
      this.press(event.pointerId);
    });
    for (const name of ["pointerup", "pointercancel", "lostpointercapture"]) {
      button.addEventListener(name, (event) => { if (event.pointerId === this.by) this.letGo(); });
    }
    // A pen on the pad takes the focus, not the finger or the key that holds.
    button.addEventListener("blur", (event) => { if (this.by === "key" && !stays(event.relatedTarget)) this.letGo(); });
    // A long press is none for a menu.
    button.addEventListener("contextmenu", (event) => event.preventDefault());
    addEventListener("blur", () => this.letGo());
  }

  press(by) {
    if (this.timer || !this.may()) return;
    this.by = by;
    this.say(true);
    this.timer = setInterval(() => this.say(true), AGAIN_MS);
  }

  letGo() {
    if (!this.timer) return;
    clearInterval(this.timer);
    this.timer = null;
    this.by = null;
    this.say(false);
  }

  shown(held) { this.button.classList.toggle("held", held); }
}
