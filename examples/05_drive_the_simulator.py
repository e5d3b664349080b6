"""Drive the simulator without a browser: puncture a vessel in a gel block, and keep a film of it."""

from sonospline.simulator import Session

session = Session("gel")
frames = [session.step().image]
for millimetre in range(1, 43):
    shot = session.step(session.command.with_needle(depth=float(millimetre)))
    frames.append(shot.image)
shot = session.settle()
vessel_moved = shot.readouts.moved
tip_to_vessel = shot.readouts.tip_to_target

if __name__ == "__main__":
    from sonospline.ultrasound.cine import write_gif

    write_gif(frames, "puncture.gif")
    print(
        f"the tip is {tip_to_vessel:.1f} mm from the vessel's middle, which moved {vessel_moved:.2f} mm: puncture.gif"
    )
