"""Pure maths: rigid transforms, the pinhole, boxes and their overlap."""
