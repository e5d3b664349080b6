"""Drive the simulator without a browser: puncture a vessel in a gel block, and keep a film of it."""

import sonospline as ss

session = ss.Session("gel")
whole = ss.Needle(entry=(26, 30, 0), tip=session.scene.targets["vessel"])
frames = [session.step()]
for k in range(1, 43):
    needle = ss.Needle(whole.entry, whole.at(k / 42))
    frames.append(session.step(needles={"needle": needle}, dt=1 / 60))
frame = session.settle()
vessel_moved = frame.readouts.moved
tip_to_vessel = frame.readouts.tip_to_target

if __name__ == "__main__":
    from sonospline.ultrasound.cine import write_gif

    write_gif([frame.image for frame in frames], "puncture.gif")
    print(
        f"the tip is {tip_to_vessel:.1f} mm from the vessel's middle, which moved {vessel_moved:.2f} mm: puncture.gif"
    )
