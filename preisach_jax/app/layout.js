// All that changes in a frame is laid out once.
//
// Bokeh measures and places everything anew at each change of a text, of what is visible, and of
// what stands in a box; a step of the page changes dozens of these.  Here a change only asks for it,
// and it is done before the next frame is drawn.

const { LayoutDOMView } = Bokeh.require("models/layouts/layout_dom")
const views = LayoutDOMView.prototype
if (!views.is_laid_out_once) {
  views.is_laid_out_once = true
  const waiting = new Set()
  let failures = 0
  // A tab in the background draws no frames.
  const soon = (done) => (document.hidden ? setTimeout(done) : requestAnimationFrame(done))
  const lay_out = () => {
    const roots = [...waiting]
    waiting.clear()
    for (const root of roots) {
      try {
        root.update_layout()
        root.compute_layout()
        failures = 0
      } catch (error) {
        // A part is being made and cannot be placed yet; it is there some frames later.
        failures += 1
        if (failures > 20) throw error
        if (waiting.size === 0) soon(lay_out)
        waiting.add(root)
      }
    }
  }
  views.invalidate_layout = function () {
    if (this.parent instanceof LayoutDOMView) {
      this.parent.invalidate_layout()
      return
    }
    if (waiting.size === 0) soon(lay_out)
    waiting.add(this)
  }
}
