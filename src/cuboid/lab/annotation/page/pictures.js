// The frames' pictures: asked for when they are shown, and the next ones before.

const KEPT = 16;

class Pictures {
  constructor() {
    this.kept = new Map(); // by frame, the latest last
  }

  /** A promise of { image } or { reason }. */
  of(frame) {
    const found = this.kept.get(frame) ?? this.load(frame);
    this.kept.delete(frame);
    this.kept.set(frame, found);
    for (const old of this.kept.keys()) {
      if (this.kept.size <= KEPT) break;
      this.kept.delete(old);
    }
    return found;
  }

  async load(frame) {
    try {
      const answer = await fetch(`/frame/${frame}.jpg`);
      if (!answer.ok) return { reason: `this frame cannot be used: ${await answer.text()}` };
      return { image: await createImageBitmap(await answer.blob()) };
    } catch {
      this.kept.delete(frame);
      return { reason: "no answer; is 'cuboid annotate' still running?" };
    }
  }
}
