"""The race behind ``sonospline bench``: problems, contenders, fair timing, report."""
