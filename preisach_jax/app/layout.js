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
  const lay_out = () => {
    const roots = [...waiting]
    waiting.clear()
    for (const root of roots) {
      root.update_layout()
      root.compute_layout()
    }
  }
  views.invalidate_layout = function () {
    if (this.parent instanceof LayoutDOMView) {
      this.parent.invalidate_layout()
      return
    }
    // A tab in the background draws no frames.
    if (waiting.size === 0) document.hidden ? setTimeout(lay_out) : requestAnimationFrame(lay_out)
    waiting.add(this)
  }
}
