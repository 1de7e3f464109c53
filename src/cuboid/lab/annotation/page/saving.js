// Every change is sent to the program at once, one after the other; it writes the file.

const RETRY = 2000; // milliseconds

class Saving {
  constructor(place) {
    this.place = place;
    this.revision = data.revision;
    this.waiting = false; // there is something newer than what was sent
    this.unsaved = false;
    this.sending = false;
    this.outdated = false;
    window.addEventListener("beforeunload", (event) => this.unsaved && event.preventDefault());
    if (keyframes.frames.length) this.say("saved", `saved in ${data.file}`);
    else this.say("new", `will be saved in ${data.file}`);
  }

  say(kind, text) {
    this.place.className = kind;
    this.place.textContent = this.place.title = text;
    document.body.dataset.saved = kind;
  }

  save() {
    this.unsaved = this.waiting = true;
    if (this.outdated) return;
    this.say("saving", "saving …");
    if (!this.sending) this.send();
  }

  async send() {
    this.sending = true;
    while (this.waiting && !this.outdated) {
      this.waiting = false;
      const answer = await post("/keyframes", { revision: this.revision, document: keyframes });
      if (answer === null) {
        this.waiting = true;
        this.say("failed", "not saved: no answer; is 'cuboid annotate' still running?");
        await new Promise((again) => setTimeout(again, RETRY));
      } else if (answer.ok) {
        this.revision = (await answer.json()).revision;
        this.unsaved = this.waiting;
        if (!this.waiting) this.say("saved", `saved in ${data.file}`);
      } else {
        // A change elsewhere: nothing of this page is saved any more, or it would undo that change.
        this.outdated = answer.status === 409;
        this.say("failed", `not saved: ${await answer.text()}`);
      }
    }
    this.sending = false;
  }
}
